"""The field: what a state in time costs, and how wrong its cheaper forms are."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from statistics import median

import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.metrics.image import psnr
from degense.engine.processes.capacity import cores
from degense.engine.progress import Progress
from degense.engine.raster import rasterize
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.scenes import trained_scene, with_count
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.timing import measure, thread_counts, threads
from degense.engine.research.benchmarks.savings import savings_table
from degense.engine.scene import Scene
from degense.engine.splats import Splats

COUNTS = {"cpu": 30_000, "cuda": 100_000}
QUICK_COUNT = 3_000
COMPARED = 5  # frames, spread over the clip, on which errors are measured


@dataclass(frozen=True)
class Way:
    """One way to have the state at a frame.

    Attributes
    ----------
    name : str
    work : callable
        What is timed, on one frame.
    state : callable or None
        Frame → the state that it gives; None where nothing can be compared.
    megabytes : float or None
        Kept for every frame.
    shift : float
        Added to the frames on which it is compared.
    """

    name: str
    work: Callable[[], object]
    state: Callable[[float], Splats] | None
    megabytes: float | None = None
    shift: float = 0.0


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    trained, words = trained_scene(options, lambda fraction, message: progress(0.5 * fraction, message))
    scene = with_count(trained, QUICK_COUNT if options.quick else COUNTS[options.device])
    words = f"{len(scene.model):,} Gaussians: {words}"
    yield _states(scene, words, options, lambda fraction, message: progress(0.5 + 0.2 * fraction, message))
    yield savings_table(scene, words, options, lambda fraction, message: progress(0.7 + 0.2 * fraction, message))
    if options.device == "cpu" and cores() > 1:
        progress(0.9, "more cores")
        yield _threads(scene, words, options)


def _states(scene: Scene, words: str, options: BenchOptions, progress: Progress) -> Table:
    table = Table(
        "field-states",
        "The state of a scene at one time",
        f"{words}. Wall time of one state, {options.repeats} repeats after 3 that warm up. Errors are against the field in float64, the "
        f"largest over {COMPARED} frames spread over the clip: of any Gaussian's centre, opacity and colour, and of the picture "
        f"({scene.clip_size[0]} × {scene.clip_size[1]}, drawn by the same back end); 100 dB stands for no difference. Between "
        "baked states stands their mean, compared half way between two frames, or on a frame that was left out.",
        [
            Column("name", "state"),
            Column("time", "ms", 3),
            Column("megabytes", "kept, MB a frame", 1),
            Column("means", f"centre, {scene.unit}", 4),
            Column("opacities", "opacity", 4),
            Column("colors", "colour, of 255", 3),
            Column("picture", "picture, dB", 1),
            Column("rms", "picture, rms of 255", 3),
        ],
        pareto=("time", "rms"),
    )
    exact = copy.deepcopy(scene.model).double()
    frames = torch.linspace(2, scene.frames - 3, COMPARED).round().int().tolist()
    ways = _ways(scene, exact, frames[0])
    for done, way in enumerate(ways):
        progress(done / len(ways), way.name)
        row: dict[str, Cell] = {"name": way.name, "megabytes": way.megabytes}
        row["time"] = measure(way.work, options.repeats, options.device)
        if way.state is not None:
            row |= _errors(scene, exact, way.state, [frame + way.shift for frame in frames])
        table.rows.append(row)
    return table


def _ways(scene: Scene, exact: SceneModel, frame: int) -> list[Way]:
    """All ways; what is timed happens at `frame`."""
    model, t = scene.model, scene.time(frame)
    baked = partial(scene.splats, semantics=True)
    bytes_of_state = sum(tensor.nbytes for tensor in vars(baked(frame)).values())
    before, here, after = (baked(frame + step) for step in (-1, 0, 1))
    halves, parts = here.map(Tensor.half), _half_but_centres(here)
    mixed = sum(tensor.nbytes for tensor in vars(parts).values())
    return [
        Way("field, float64", lambda: exact.at(t), lambda f: _evaluated(scene, exact, f)),
        Way("field", lambda: model.at(t), lambda f: _evaluated(scene, model, f)),
        Way("field, without semantics", lambda: model.at(t, semantics=False), lambda f: _evaluated(scene, model, f, semantics=False)),
        Way("field, centres only", lambda: model.means_at(t), None),
        Way("baked", lambda: baked(frame), baked, bytes_of_state / 1e6),
        Way(
            "baked, float16 but centres",
            lambda: parts.map(Tensor.float),
            lambda f: _half_but_centres(baked(f)).map(Tensor.float),
            mixed / 1e6,
        ),
        Way(
            "baked, float16",
            lambda: halves.map(Tensor.float),
            lambda f: baked(f).map(Tensor.half).map(Tensor.float),
            bytes_of_state / 2e6,
        ),
        Way(
            "between two baked frames",
            lambda: _between(here, after),
            lambda f: _between(baked(f - 0.5), baked(f + 0.5)),
            bytes_of_state / 1e6,
            shift=0.5,
        ),
        Way(
            "every second frame baked",
            lambda: _between(before, after),
            lambda f: _between(baked(f - 1), baked(f + 1)),
            bytes_of_state / 2e6,
        ),
    ]


def _evaluated(scene: Scene, model: SceneModel, frame: float, semantics: bool = True) -> Splats:
    """The field's state in the clip's unit."""
    splats, unit = model.at(scene.time(frame), semantics=semantics).splats, scene.run.info["unit"]
    return replace(splats, means=splats.means / unit, scales=splats.scales / unit)


def _half_but_centres(splats: Splats) -> Splats:
    return replace(splats.map(Tensor.half), means=splats.means)


def _between(a: Splats, b: Splats) -> Splats:
    """The state half way between two."""
    return Splats(**{f.name: torch.lerp(getattr(a, f.name), getattr(b, f.name), 0.5) for f in fields(Splats)})


def _errors(scene: Scene, exact: SceneModel, state: Callable[[float], Splats], frames: list[float]) -> dict[str, Cell]:
    """Largest distance of `state` from the exact field over `frames`, by column."""
    worst = {"means": 0.0, "opacities": 0.0, "colors": 0.0, "rms": 0.0, "picture": float("inf")}
    for frame in frames:
        got, true = state(frame), _evaluated(scene, exact, frame)
        for name in ("means", "opacities", "colors"):
            apart = (getattr(got, name).double() - getattr(true, name)).abs().max().item() * (255 if name == "colors" else 1)
            worst[name] = max(worst[name], apart)
        picture, right = (_picture(splats, scene, frame) for splats in (got, true))
        worst["rms"] = max(worst["rms"], 255 * (picture - right).square().mean().sqrt().item())
        worst["picture"] = min(worst["picture"], psnr(picture.cpu().numpy(), right.cpu().numpy()) or 0.0)
    return dict(worst)


def _picture(splats: Splats, scene: Scene, frame: float) -> Tensor:
    image = rasterize(splats, splats.colors, scene.camera(frame)).image
    return image.clamp(0, 1)


def _threads(scene: Scene, words: str, options: BenchOptions) -> Table:
    table = Table(
        "field-threads",
        "The field on more cores",
        f"{words}. Wall time of one state, {options.repeats} repeats, with 1, 2, 4, … threads up to the {cores()} cores of this machine. "
        "Speed-ups are of medians, against one thread.",
        [Column("threads", "threads")],
    )
    t = scene.time(1)
    works = {"all": lambda: scene.model.at(t), "without semantics": lambda: scene.model.at(t, semantics=False)}
    for name in works:
        table.columns += [Column(name, f"field, {name}, ms"), Column(f"{name} gain", "speed-up")]
    alone: dict[str, float] = {}
    for number in thread_counts(cores()):
        row: dict[str, Cell] = {"threads": number}
        with threads(number):
            for name, work in works.items():
                times = measure(work, options.repeats)
                row |= {name: times, f"{name} gain": alone.setdefault(name, median(times)) / median(times)}
        table.rows.append(row)
    return table
