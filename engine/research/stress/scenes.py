"""Gaussians that nobody wants: every back end's answer beside float64."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.child import call_in_child, peak_memory
from degense.engine.research.bench.raster_check import GRADIENT_TOLERANCE, OUTLIER_TOLERANCE, Case, compare, hostile_cases
from degense.engine.research.bench.raster_scenes import draw_scene, random_scene
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Table
from degense.engine.research.raster_reference import rasterize_reference
from degense.engine.research.stress.outcome import COLUMNS, StressFinding, non_finite, row, verdict
from degense.engine.splats import Splats

WINDOW = (48, 32)  # pixels in the middle of a large picture that the reference draws too


def table(options: BenchOptions, progress: Progress = silent) -> Table:
    """All scenes on the device's own back end."""
    rows = []
    small = [*hostile_cases(11), *stress_cases(11)]
    for i, case in enumerate(small):
        progress(0.5 * i / len(small), case.name)
        rows.append(row(case.name, partial(small_finding, case, options.device)))
    shrink = 10 if options.quick else 1
    large = [
        ("{:,} Gaussians, 1280 × 720", 1_000_000 // shrink, 1280, 720, 2.0),
        ("{:,} Gaussians, 3840 × 2160", 300_000 // shrink, 3840, 2160, 4.0),
        ("{:,} Gaussians on one another, 640 × 512", 10_000, 640, 512, 0.0),  # the reference holds every pair of pixel and Gaussian
    ]
    for i, (name, count, width, height, footprint) in enumerate(large):
        progress(0.5 + 0.5 * i / len(large), name.format(count))
        rows.append(row(name.format(count), partial(large_finding, count, width, height, footprint, options.device)))
    return Table(
        "stress-scenes",
        "Hostile scenes",
        f"Back end of {options.device}, forward and backward of a random loss over image and alpha. Error: greatest difference of a "
        "pixel or an alpha from the float64 reference, over the largest feature where that exceeds 1. Gradient error: the largest "
        f"over the inputs of ‖g − g64‖ / ‖g64‖. Allowed: {OUTLIER_TOLERANCE} and {GRADIENT_TOLERANCE}. Small scenes have 200 Gaussians "
        "and 47 × 33 pixels and are compared whole. Large ones run in a process of their own, whose peak memory is given (on a GPU: "
        f"memory of its tensors), and are compared, with the gradient of a loss there, in a window of {WINDOW[0]} × {WINDOW[1]} pixels "
        "in the middle; their seconds are of forward and backward, without the reference.",
        list(COLUMNS),
        rows,
    )


def small_finding(case: Case, device: str) -> StressFinding:
    """A scene that the reference draws whole."""
    result = compare(case, device)
    features = case.splats.semantics
    size = max(1.0, float(features[features.isfinite()].abs().max())) if features.isfinite().any() else 1.0
    image, gradient = max(result.image / size, result.alpha), max(result.gradients.values(), default=0.0)
    return StressFinding(
        0 if result.finite else 1, verdict(image=(image, OUTLIER_TOLERANCE), gradient=(gradient, GRADIENT_TOLERANCE)), image, gradient
    )


def large_finding(count: int, width: int, height: int, footprint: float, device: str) -> StressFinding:
    """A scene that the reference draws a window of."""
    seconds, memory, image, gradient, bad = call_in_child(draw_large, count, width, height, footprint, device)
    return StressFinding(
        bad, verdict(image=(image, OUTLIER_TOLERANCE), gradient=(gradient, GRADIENT_TOLERANCE)), image, gradient, memory, seconds
    )


def draw_large(count: int, width: int, height: int, footprint: float, device: str) -> tuple[float, float | None, float, float, int]:
    """Seconds and MB of forward and backward, image error and gradient error in the window, and how many numbers are not finite.

    A footprint of 0 puts all Gaussians in one place, at one depth.
    """
    splats, camera = random_scene(count, width, height, 4, 0, footprint=footprint or 3.0)
    if not footprint:
        splats.means = torch.tensor([[0.0, 0.0, 1.0]]).repeat(count, 1)
    window = ((width - WINDOW[0]) // 2, (height - WINDOW[1]) // 2, *WINDOW)
    left, top, wide, high = window
    seen = np.s_[top : top + high, left : left + wide]
    pull = torch.randn(WINDOW[1], WINDOW[0], 4, generator=torch.Generator().manual_seed(1))
    leaves = splats.map(lambda tensor: tensor.clone().to(device).requires_grad_())
    draw_scene(leaves, camera).image.sum().backward()  # compiles, fills caches
    drawn = drawn_tensors(leaves)
    for leaf in drawn:
        leaf.grad = None
    begin = time.perf_counter()
    render = draw_scene(leaves, camera)
    (render.image[seen] * pull.to(device)).sum().backward()
    gradients = [leaf.grad.cpu() for leaf in drawn if leaf.grad is not None]
    seconds = time.perf_counter() - begin
    memory = torch.cuda.max_memory_allocated() / 2**20 if device == "cuda" else peak_memory()
    bad = non_finite([render.image, render.alpha, *gradients])

    near = touching(splats, camera, window)
    exact = splats.map(lambda tensor: tensor[near].double().requires_grad_())
    image, alpha, _ = rasterize_reference(exact, exact.semantics, camera, None, None, window=window)
    (image * pull).sum().backward()
    distances = [(mine.detach().cpu()[seen] - true.detach()).abs() for mine, true in ((render.image, image), (render.alpha, alpha))]
    error = max(float(distance.max()) for distance in distances)
    worst = 0.0
    for mine, part in zip(gradients, drawn_tensors(exact), strict=True):
        true = torch.zeros_like(mine, dtype=torch.float64)
        assert part.grad is not None
        true[near] = part.grad
        worst = max(worst, float((mine - true).norm() / true.norm().clamp(min=1e-6)))
    return seconds, memory, error, worst, bad


def drawn_tensors(splats: Splats) -> tuple[Tensor, ...]:
    """What `draw_scene` reads."""
    return splats.means, splats.quats, splats.scales, splats.opacities, splats.semantics


def touching(splats: Splats, camera: Camera, window: tuple[int, int, int, int]) -> Tensor:
    """Indices of the Gaussians whose box may reach into a window (left, top, width, height): all that the reference has to look at."""
    with torch.no_grad():
        radii = draw_scene(splats, camera).radii
        points, _ = camera.project(splats.means.double().numpy())
    left, top, wide, high = window
    place, reach = torch.from_numpy(points), radii[:, None] + 1
    low, beyond = torch.tensor([left, top]), torch.tensor([left + wide, top + high])
    inside = ((place + reach > low) & (place - reach < beyond)).all(1)
    return (inside & (radii > 0)).nonzero()[:, 0]


def stress_cases(seed: int) -> Iterator[Case]:
    """What `hostile_cases` leaves out: whole scenes of one degenerate kind."""

    def case(name: str, change: Callable[[Splats], object], camera: Camera | None = None, **options) -> Case:
        splats, plain = random_scene(200, 47, 33, 4, seed, **options)
        change(splats)
        return Case(name, splats, camera or plain, torch.linspace(0.1, 0.7, 4), torch.zeros(200, 2))

    def spread(low: float, high: float) -> Tensor:
        return torch.logspace(low, high, 200)[torch.randperm(200, generator=torch.Generator().manual_seed(seed))]

    def set_scales(*axes: float) -> Callable[[Splats], object]:
        return lambda splats: splats.scales.copy_(torch.tensor(axes))

    yield case("needles, 1 : 1,000,000", set_scales(1.0, 1e-6, 1e-6))
    yield case("discs without thickness", set_scales(0.1, 0.1, 0.0))
    yield case("lines without width", set_scales(0.5, 0.0, 0.0))
    yield case("scales from 1e-30 to 1e30", lambda s: s.scales.copy_(spread(-30, 30)[:, None]))
    yield case("subnormal scales", lambda s: s.scales.fill_(1e-40))
    yield case("all in one place", lambda s: s.means.copy_(s.means.new_tensor([0.0, 0.0, 1.0])))
    yield case("all at one depth", lambda s: s.means[:, 2].fill_(1.0))
    yield case("pairs in one place", lambda s: s.means[::2].copy_(s.means[1::2]))
    yield case("opacity 1, one behind the other", lambda s: (s.opacities.fill_(1.0), s.scales.fill_(1.0)))
    yield case("opacity just above 1/255", lambda s: s.opacities.fill_(1.001 / 255))
    yield case("opacity from 1e-30 to 1", lambda s: s.opacities.copy_(spread(-30, 0)))
    yield case("depths from 0.0101 to 1e9", lambda s: s.means.mul_((spread(-1.99, 9) / s.means[:, 2])[:, None]))
    yield case("just behind the near plane", lambda s: s.means.mul_((0.010001 / s.means[:, 2])[:, None]))
    yield case("features up to 1e18", lambda s: s.semantics.copy_(spread(-18, 18)[:, None]))
    yield case("quaternions from 1e-11 to 1e18", lambda s: s.quats.mul_(spread(-11, 18)[:, None]))
    yield case("focal length 0.5 pixels", lambda s: None, Camera(47, 33, 0.5, 0.5, 23.5, 16.5))
    yield case("focal length 1e6 pixels", lambda s: None, Camera(47, 33, 1e6, 1e6, 23.5, 16.5))
    yield case("principal point far outside", lambda s: None, Camera(47, 33, 42.3, 42.3, 1e4, -1e4))
    for name, kind in (("half precision", Tensor.half), ("bfloat16", Tensor.bfloat16), ("float64", Tensor.double)):
        splats, camera = random_scene(200, 47, 33, 4, seed)
        yield Case(name, splats.map(kind), camera)
    broken = torch.Generator().manual_seed(seed)

    def ruin(splats: Splats) -> None:
        for tensor in drawn_tensors(splats):
            tensor[torch.rand(tensor.shape, generator=broken) < 0.1] = torch.nan
            tensor[torch.rand(tensor.shape, generator=broken) < 0.02] = -torch.inf

    yield case("a tenth of all numbers NaN", ruin)
