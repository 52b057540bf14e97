"""Do all back ends of the rasterizer agree with its float64 reference?

`python -m degense.engine.research.bench.raster_check` prints a table of values, gradients and hostile input; the exit status is 1 if a row
fails. Where a Gaussian's alpha lies within rounding of 1/255 a pixel may be off by 1/255, so a few such pixels are allowed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.raster.render import Render, rasterize
from degense.engine.research.bench.raster_scenes import random_scene
from degense.engine.splats import Splats

INPUTS = ("means", "quats", "scales", "opacities", "features", "background", "offsets")
IMAGE_TOLERANCE, OUTLIERS, OUTLIER_TOLERANCE, GRADIENT_TOLERANCE, RADII_TOLERANCE = 1e-3, 2e-3, 6e-3, 1e-2, 0.01
ROUNDING = 1e-5  # of a case's largest gradient: what float32 leaves of sums that ought to vanish


@dataclass
class Case:
    """Gaussians to draw, whose semantics are the features, and which of INPUTS need gradients."""

    name: str
    splats: Splats
    camera: Camera
    background: Tensor | None = None
    offsets: Tensor | None = None
    wanted: tuple[str, ...] = INPUTS

    @property
    def inputs(self) -> dict[str, Tensor]:
        """Those of INPUTS that are there."""
        s = self.splats
        tensors = (s.means, s.quats, s.scales, s.opacities, s.semantics, self.background, self.offsets)
        return {name: tensor for name, tensor in zip(INPUTS, tensors, strict=True) if tensor is not None}


@dataclass
class Comparison:
    """Distance of a back end from the reference.

    Attributes
    ----------
    image, alpha : float
        Greatest difference of a pixel.
    outliers : float
        Share of pixels whose image differs by more than IMAGE_TOLERANCE.
    radii : float
        Share of Gaussians drawn by only one of the two, or with boxes that differ by more than the rounding to whole pixels. A few
        may be: those whose box touches the border of the picture.
    gradients : dict of str to float
        ‖g − g_ref‖ / ‖g_ref‖ by input. What symmetry makes zero (the turn of a ball) is measured by `ROUNDING` of the largest ‖g_ref‖.
    finite : bool
        Every output is finite.
    """

    image: float
    outliers: float
    alpha: float
    radii: float
    gradients: dict[str, float] = field(default_factory=dict)
    finite: bool = True

    @property
    def passes(self) -> bool:
        image = self.outliers <= OUTLIERS and max(self.image, self.alpha) <= OUTLIER_TOLERANCE
        return (
            self.finite
            and image
            and self.radii <= RADII_TOLERANCE
            and all(error <= GRADIENT_TOLERANCE for error in self.gradients.values())
        )


def draw(case: Case, device: str, backend: str = "auto") -> tuple[Render, dict[str, Tensor]]:
    """The picture, and gradients of a fixed random loss over image and alpha for the wanted inputs."""
    inputs = {name: tensor.detach().to(device).requires_grad_(name in case.wanted) for name, tensor in case.inputs.items()}
    splats = replace(case.splats.to(device), **{name: inputs[name] for name in INPUTS[:4]})
    background, offsets = inputs.get("background"), inputs.get("offsets")
    render = rasterize(splats, inputs["features"], case.camera, background=background, screen_offsets=offsets, backend=backend)
    generator = torch.Generator().manual_seed(1)
    image_pull, alpha_pull = (torch.randn(part.shape, generator=generator).to(part) for part in (render.image, render.alpha))
    loss = (render.image * image_pull).sum() + (render.alpha * alpha_pull).sum()
    if loss.requires_grad:
        loss.backward()
    return render, {name: tensor.grad for name, tensor in inputs.items() if tensor.grad is not None}


def compare(case: Case, device: str, backend: str = "auto") -> Comparison:
    """Draw on a device and by the reference, and measure the distance."""
    render, gradients = draw(case, device, backend)
    truth, true_gradients = draw(case, "cpu", "reference")
    error = (render.image.detach().cpu() - truth.image.detach()).abs()
    errors = {}
    least = ROUNDING * max((true.norm().item() for true in true_gradients.values()), default=0.0)
    for name, true in true_gradients.items():
        got = gradients[name].cpu().double() if name in gradients else torch.zeros_like(true)  # no gradient is a zero gradient
        errors[name] = ((got - true).norm() / true.norm().clamp(min=max(1e-6, least))).item()
    far_radii = ((render.radii.cpu() - truth.radii).abs() > 1) | ((render.radii.cpu() > 0) != (truth.radii > 0))
    outputs = [render.image, render.alpha, *gradients.values()]
    return Comparison(
        image=error.max().item(),
        outliers=(error.amax(2) > IMAGE_TOLERANCE).double().mean().item(),
        alpha=(render.alpha.detach().cpu() - truth.alpha.detach()).abs().max().item(),
        radii=far_radii.double().mean().item() if len(far_radii) else 0.0,
        gradients=errors,
        finite=all(bool(output.isfinite().all()) for output in outputs),
    )


def cases(seed: int) -> Iterator[Case]:
    """Well-behaved scenes: sizes, channels, cameras, and combinations of gradients."""

    def case(name: str, count: int, width: int, height: int, channels: int, **options) -> Case:
        splats, camera = random_scene(count, width, height, channels, seed, **options)
        generator = torch.Generator().manual_seed(seed + 1)
        return Case(name, splats, camera, torch.rand(channels, generator=generator), torch.randn(count, 2, generator=generator) * 0.1)

    plain = case("plain, 4 channels", 400, 96, 72, 4)
    yield plain
    yield replace(plain, name="no background, no offsets", background=None, offsets=None)
    yield replace(plain, name="features only need gradients", wanted=("features",))
    yield replace(plain, name="geometry only needs gradients", wanted=("means", "quats", "scales", "opacities"))
    yield case("turned camera", 400, 96, 72, 3, turned=True)
    yield case("small Gaussians", 400, 97, 71, 4, footprint=0.3)
    yield case("large Gaussians, edges clamped", 100, 65, 49, 4, footprint=30.0, turned=True)
    yield case("dense: pixels finish early", 2500, 33, 35, 4, footprint=4.0)
    for channels in (1, 2, 5, 7, 20, 33, 64, 70):
        yield case(f"{channels} channels", 150, 47, 31, channels)
    for width, height in ((1, 1), (2, 17), (31, 16), (33, 17)):
        yield case(f"{width} × {height} pixels", 60, width, height, 3, footprint=1.5)


def hostile_cases(seed: int) -> Iterator[Case]:
    """Input that optimisers and files produce and nobody wants, each mixed into a sound scene."""
    nan, inf = torch.nan, torch.inf
    changes: list[tuple[str, str, Callable[[Tensor], Tensor]]] = [
        ("zero quaternions", "quats", lambda quats: quats[::3].zero_()),
        ("tiny quaternions", "quats", lambda quats: quats[::3].mul_(1e-20)),
        ("NaN quaternions", "quats", lambda quats: quats[::3, 2].fill_(nan)),
        ("scales 0", "scales", lambda scales: scales[::3].zero_()),
        ("scales 1e-12", "scales", lambda scales: scales[::3].fill_(1e-12)),
        ("scales 1e6", "scales", lambda scales: scales[::40].fill_(1e6)),
        ("infinite scales", "scales", lambda scales: scales[::3, 0].fill_(inf)),
        ("NaN scales", "scales", lambda scales: scales[::3, 0].fill_(nan)),
        ("opacity 0", "opacities", lambda opacities: opacities[::3].zero_()),
        ("opacity 1", "opacities", lambda opacities: opacities[::3].fill_(1.0)),
        ("opacity outside [0, 1]", "opacities", lambda opacities: opacities[::3].mul_(9.0).sub_(3.0)),
        ("NaN opacities", "opacities", lambda opacities: opacities[::3].fill_(nan)),
        ("infinite opacities", "opacities", lambda opacities: opacities[::3].fill_(inf)),
        ("at the camera", "means", lambda means: means[::3].zero_()),
        ("behind the camera", "means", lambda means: means[::3, 2].mul_(-1.0)),
        ("all behind the camera", "means", lambda means: means[:, 2].mul_(-1.0)),
        ("far away", "means", lambda means: means[::3].mul_(1e12)),
        ("NaN means", "means", lambda means: means[::3, 1].fill_(nan)),
        ("infinite means", "means", lambda means: means[::3, 0].fill_(inf)),
        ("NaN features", "semantics", lambda features: features[::3, -1].fill_(nan)),
        ("all features infinite", "semantics", lambda features: features.fill_(inf)),
    ]
    background = torch.linspace(0.1, 0.7, 4)
    for name, changed, change in changes:
        splats, camera = random_scene(200, 47, 33, 4, seed)
        change(getattr(splats, changed))
        yield Case(name, splats, camera, background, torch.zeros(200, 2))
    splats, camera = random_scene(200, 47, 33, 4, seed)
    offsets = torch.zeros(200, 2)
    offsets[::3] = torch.nan
    yield Case("NaN offsets", splats, camera, None, offsets)
    yield Case("no Gaussians", splats.map(lambda tensor: tensor[:0]), camera, background, torch.zeros(0, 2))
    wide, turned = torch.cat([splats.means, splats.means], 1)[:, :3], splats.quats.flip(1)
    yield Case("not contiguous", replace(splats, means=wide, quats=turned, scales=splats.scales.T.contiguous().T), camera)


def main() -> int:
    """Print the tables; 1 if anything fails."""
    torch.manual_seed(0)
    failures = 0
    devices = ["cpu"] + (["cuda"] if torch.cuda.is_available() else [])
    print(
        f"torch {torch.__version__}, {torch.get_num_threads()} threads" + (f", {torch.cuda.get_device_name()}" if len(devices) > 1 else "")
    )
    for device in devices:
        for title, group in (("scenes", cases), ("hostile input", hostile_cases)):
            print(f"\n{device}: {title}\n{'':34s}{'image':>9s}{'>1e-3':>9s}{'alpha':>9s}{'radii':>9s}  relative gradient errors")
            for seed in (11, 12) if title == "scenes" else (11,):
                for case in group(seed):
                    result = compare(case, device)
                    errors = " ".join(f"{name} {error:.1e}" for name, error in result.gradients.items())
                    verdict = "" if result.passes else "   FAILS" + ("" if result.finite else " (not finite)")
                    print(
                        f"{case.name:34s}{result.image:9.1e}{result.outliers:9.1e}{result.alpha:9.1e}{result.radii:9.1e}  {errors}{verdict}"
                    )
                    failures += not result.passes
    print(f"\n{failures} rows fail" if failures else "\nall rows pass")
    return min(failures, 1)


if __name__ == "__main__":
    sys.exit(main())
