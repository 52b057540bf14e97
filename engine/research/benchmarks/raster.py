"""The rasterizer's back ends: what a picture and its gradient cost, and how wrong they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from statistics import median

import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.processes.capacity import cores
from degense.engine.progress import Progress
from degense.engine.raster.camera_tensors import intrinsic_matrix, view_matrix
from degense.engine.raster.limits import NEAR
from degense.engine.research.bench.raster_scenes import draw_scene, random_scene
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.timing import measure, thread_counts, threads
from degense.engine.splats import Splats

CHANNELS = (4, 20)
COUNTS, SIZES = (1_000, 10_000, 30_000, 100_000), ((320, 256), (640, 512), (854, 480), (1920, 1080))
QUICK_COUNTS, QUICK_SIZES = (1_000, 5_000), ((320, 256),)
FOOTPRINT = 0.756  # median σ on the screen in units of √(pixels / Gaussians): 2.5 pixels for 30,000 Gaussians at 640 × 512
SMALL = (400, 96, 72)  # Gaussians, width, height: what the reference draws with gradients in a fraction of a second

#: Which tensors of the Gaussians are rounded to float16; their semantics are the features that are drawn.
ROUNDED: dict[str, tuple[str, ...]] = {
    "float32": (),
    "features float16": ("semantics",),
    "all but centres float16": ("quats", "scales", "opacities", "semantics"),
    "all float16": ("means", "quats", "scales", "opacities", "semantics"),
}

#: Draws the semantics of Gaussians for a camera; the image [H, W, C].
Draw = Callable[[Splats, Camera], Tensor]
Plan = tuple[str, Draw, str, tuple[str, ...]]


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    yield _errors(options, lambda fraction, message: progress(0.1 * fraction, message))
    yield _times(options, lambda fraction, message: progress(0.1 + 0.7 * fraction, message))
    if options.device == "cpu" and cores() > 1:
        yield _threads(options, lambda fraction, message: progress(0.8 + 0.2 * fraction, message))


def back_ends(device: str) -> dict[str, Draw]:
    """What can draw on a device, by the name it has in the tables."""
    if device == "cpu":
        return {"cpu (numba)": _ours}
    return {"cuda (ours)": _ours, "cuda (ours, clean)": _clean, "gsplat `rasterization`": gsplats_own}


def _ours(splats: Splats, camera: Camera) -> Tensor:
    return draw_scene(splats, camera).image


def _clean(splats: Splats, camera: Camera) -> Tensor:
    """For Gaussians that are known to be sound, as a baked state's are."""
    return draw_scene(splats, camera, clean=True).image


def reference(splats: Splats, camera: Camera) -> Tensor:
    """The float64 oracle."""
    return draw_scene(splats, camera, backend="reference").image


def gsplats_own(splats: Splats, camera: Camera) -> Tensor:
    """gsplat's own entry point, with our near plane."""
    from gsplat import rasterization

    tensors = splats.means, splats.quats, splats.scales, splats.opacities, splats.semantics
    view, lens = view_matrix(camera, splats.means.device)[None], intrinsic_matrix(camera, splats.means.device)[None]
    return rasterization(*tensors, view, lens, camera.width, camera.height, near_plane=NEAR, packed=False)[0][0]


def sized_scene(count: int, width: int, height: int, channels: int, device: str, seed: int = 0) -> tuple[Splats, Camera]:
    """A random scene whose Gaussians overlap as much whatever their number and the picture's size."""
    splats, camera = random_scene(count, width, height, channels, seed, footprint=FOOTPRINT * (width * height / count) ** 0.5)
    return splats.to(device), camera


def works(draw: Draw, splats: Splats, camera: Camera) -> dict[str, Callable[[], object]]:
    """What is timed: a picture, a picture with all gradients, and one with gradients of the features only."""
    leaves = splats.map(lambda tensor: tensor.clone().requires_grad_())

    def forward() -> Tensor:
        with torch.no_grad():
            return draw(splats, camera)

    pull = torch.randn_like(forward())
    return {
        "forward": forward,
        "both": lambda: draw(leaves, camera).backward(pull),
        "features": lambda: draw(replace(splats, semantics=leaves.semantics), camera).backward(pull),
    }


def _times(options: BenchOptions, progress: Progress) -> Table:
    counts, sizes = (QUICK_COUNTS, QUICK_SIZES) if options.quick else (COUNTS, SIZES)
    table = Table(
        "raster-time",
        "Time of a picture and its gradients",
        f"Random scenes whose Gaussians overlap equally in all rows: median σ on the screen {FOOTPRINT:g} · √(pixels / Gaussians), that is "
        f"2.5 pixels for 30,000 at 640 × 512. Wall time, {options.repeats} repeats after 3 that warm up; seed 0. *Features only*: forward "
        "and backward with gradients of nothing but the features, as a semantic pass has them.",
        [
            Column("back end", "back end"),
            Column("count", "Gaussians"),
            Column("size", "picture"),
            Column("channels", "channels"),
            Column("forward", "forward, ms"),
            Column("both", "forward + backward, ms"),
            Column("features", "features only, ms"),
        ],
    )
    jobs = [(size, count, channels) for size in sizes for count in counts for channels in CHANNELS]
    for done, ((width, height), count, channels) in enumerate(jobs):
        progress(done / len(jobs), f"{count:,} Gaussians, {width} × {height}, {channels} channels")
        splats, camera = sized_scene(count, width, height, channels, options.device)
        for name, draw in back_ends(options.device).items():
            row: dict[str, Cell] = {"back end": name, "count": count, "size": f"{width} × {height}", "channels": channels}
            for key, work in works(draw, splats, camera).items():
                row[key] = measure(work, options.repeats, options.device)
            table.rows.append(row)
    return table


def _errors(options: BenchOptions, progress: Progress) -> Table:
    """Every back end and precision against the float64 reference, on a scene small enough for it."""
    count, width, height = SMALL
    table = Table(
        "raster-error",
        "Error against the float64 reference, and time, on a small scene",
        f"{count} Gaussians, {width} × {height} pixels: the reference draws every Gaussian against every pixel in float64, which is "
        f"practical with gradients at such a size only. Random scenes of {len(options.seeds)} seeds. Image: greatest difference of any "
        "pixel and channel, features in [0, 1]. Gradient: ‖g − g_ref‖ / ‖g_ref‖ of the input furthest off, for a random loss. float16: "
        f"these inputs are rounded to it, drawing stays in float32. Times: {options.repeats} repeats, of the reference at most 3.",
        [
            Column("name", "back end, inputs, channels"),
            Column("forward", "forward, ms"),
            Column("both", "forward + backward, ms"),
            Column("image", "largest image error", 3),
            Column("gradient", "relative gradient error", 3),
        ],
        pareto=("forward", "image"),
    )
    plans: list[Plan] = [("reference, float64", reference, "cpu", ())]
    for name, draw in back_ends(options.device).items():
        kinds = {"float32": ROUNDED["float32"]} if draw is gsplats_own else ROUNDED  # gsplat itself takes nothing else
        plans += [(f"{name}, {inputs}", draw, options.device, rounded) for inputs, rounded in kinds.items()]
    jobs = [(channels, plan) for channels in CHANNELS for plan in plans]
    for done, (channels, (name, draw, place, rounded)) in enumerate(jobs):
        progress(done / len(jobs), f"against the reference: {name}, {channels} channels")
        scenes = [random_scene(count, width, height, channels, seed) for seed in options.seeds]
        errors = [_distance(draw, splats, rounded, camera, place) for splats, camera in scenes]
        splats, camera = scenes[0]
        timed = works(draw, _with_half(splats, rounded).to(place), camera)
        slow = draw is reference
        row: dict[str, Cell] = {"name": f"{name}, {channels}", "image": [e[0] for e in errors], "gradient": [e[1] for e in errors]}
        for key in ("forward", "both"):
            row[key] = measure(timed[key], min(options.repeats, 3) if slow else options.repeats, place, warm=1 if slow else 3)
        table.rows.append(row)
    return table


def _with_half(splats: Splats, rounded: tuple[str, ...]) -> Splats:
    return replace(splats, **{name: getattr(splats, name).half() for name in rounded})


def _distance(draw: Draw, splats: Splats, rounded: tuple[str, ...], camera: Camera, place: str) -> tuple[float, float]:
    """Greatest difference of a pixel from the reference, and the relative error of the gradient that is furthest off."""
    given = _with_half(splats, rounded).map(Tensor.float).to(place)
    (image, gradients), (truth, true_gradients) = (_outcome(d, s, camera) for d, s in ((draw, given), (reference, splats)))
    apart = [((g - true).norm() / true.norm().clamp_min(1e-12)).item() for g, true in zip(gradients, true_gradients, strict=True)]
    return (image - truth).abs().max().item(), max(apart)


def _outcome(draw: Draw, splats: Splats, camera: Camera) -> tuple[Tensor, list[Tensor]]:
    """The image, and the gradients of a fixed random loss, float64 on the CPU."""
    leaves = splats.map(lambda tensor: tensor.detach().clone().requires_grad_())
    image = draw(leaves, camera)
    image.backward(torch.randn(image.shape, generator=torch.Generator().manual_seed(1)).to(image))
    drawn = (leaves.means, leaves.quats, leaves.scales, leaves.opacities, leaves.semantics)
    gradients = [torch.zeros_like(leaf) if leaf.grad is None else leaf.grad for leaf in drawn]
    return image.detach().cpu().double(), [gradient.cpu().double() for gradient in gradients]


def _threads(options: BenchOptions, progress: Progress) -> Table:
    count, (width, height) = (5_000, (320, 256)) if options.quick else (30_000, (640, 512))
    table = Table(
        "raster-threads",
        "The CPU back end on more cores",
        f"{count:,} Gaussians, {width} × {height}, overlap as in the table of times; 1, 2, 4, … threads up to the {cores()} cores of "
        f"this machine; {options.repeats} repeats. Speed-ups are of medians, against one thread.",
        [
            Column("threads", "threads"),
            Column("channels", "channels"),
            Column("forward", "forward, ms"),
            Column("forward_gain", "speed-up"),
            Column("both", "forward + backward, ms"),
            Column("both_gain", "speed-up"),
        ],
    )
    jobs = [(channels, number) for channels in CHANNELS for number in thread_counts(cores())]
    alone: dict[tuple[int, str], float] = {}
    for done, (channels, number) in enumerate(jobs):
        progress(done / len(jobs), f"{number} threads")
        timed = works(_ours, *sized_scene(count, width, height, channels, "cpu"))
        row: dict[str, Cell] = {"threads": number, "channels": channels}
        with threads(number):
            for key in ("forward", "both"):
                times = measure(timed[key], options.repeats)
                row |= {key: times, f"{key}_gain": alone.setdefault((channels, key), median(times)) / median(times)}
        table.rows.append(row)
    return table
