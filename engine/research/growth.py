"""How the cost of a training grows with frames, pixels, Gaussians and classes, each alone."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from degense.engine.data.readers import open_clip
from degense.engine.profile import Profile, recording
from degense.engine.progress import Progress
from degense.engine.research.bench.child import call_in_child, peak_memory
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.stress.long_clips import write_pictures
from degense.engine.training import TrainConfig, train

STEPS = 40  # of a training, and as many of the semantic stage
COSTS = {"flow": "optical flow, s", "step": "a step, ms", "semantics": "semantic stage, s", "save": "saving, s", "whole": "all, s"}
MEMORY = {"memory": "memory, MB", "card": "of the card, MB"}


@dataclass(frozen=True)
class Size:
    """What a training is given."""

    frames: int = 100
    pixels: tuple[int, int] = (320, 256)
    gaussians: int = 10_000
    classes: int = 2


#: What grows, in steps; all else is as `Size` has it, and for the Gaussians the frames are large enough for as many to begin with.
LADDERS: dict[str, tuple[Size, ...]] = {
    "frames": tuple(Size(frames=n) for n in (50, 100, 200, 500, 1_000, 2_000)),
    "pixels": tuple(Size(pixels=size, frames=24) for size in ((320, 256), (640, 512), (1280, 1024), (1920, 1080), (3840, 2160))),
    "Gaussians": tuple(Size(gaussians=n, frames=24, pixels=(1280, 1024)) for n in (10_000, 30_000, 100_000, 300_000, 1_000_000)),
    "classes": tuple(Size(classes=n, frames=24) for n in (2, 4, 8, 16, 32)),
}
QUICK_LADDERS: dict[str, tuple[Size, ...]] = {
    "frames": tuple(Size(frames=n, pixels=(96, 80), gaussians=300) for n in (6, 12, 24)),
    "classes": tuple(Size(classes=n, pixels=(96, 80), gaussians=300, frames=6) for n in (2, 3)),
}


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """A table for each thing that grows."""
    ladders = QUICK_LADDERS if options.quick else LADDERS
    total, done = sum(len(ladder) for ladder in ladders.values()), 0
    for what, ladder in ladders.items():
        rows = []
        for size in ladder:
            progress(done / total, f"{what}: {size.frames} frames of {size.pixels[0]} × {size.pixels[1]}")
            rows.append(_measured(options, size))
            done += 1
        yield _table(what, ladder, rows)


def _measured(options: BenchOptions, size: Size) -> dict[str, Cell]:
    """The costs of one training, in a process of its own; one on few pixels goes before it there, which loads the kernels."""
    folder = options.scratch / "growth"
    classes = [f"class {k}" for k in range(size.classes)]
    try:
        write_pictures(folder / "small", 3, 96, 80, classes)
        write_pictures(folder / "clip", size.frames, *size.pixels, classes)
        return call_in_child(costs_of, folder, size, options.device)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def costs_of(folder: Path, size: Size, device: str) -> dict[str, Cell]:
    """Seconds by stage and memory of a short training on `folder`/clip."""
    config = TrainConfig.preset_of(
        "quick",
        iterations=STEPS,
        semantic_steps=STEPS,
        max_gaussians=size.gaussians,
        max_pixels=math.prod(size.pixels),
        device=device,
        checkpoint_seconds=1e9,
    )
    quiet: dict[str, Any] = {"teacher": "labels", "events": lambda event: None, "stop": lambda: False}
    train(open_clip(folder / "small"), folder / "warm", replace(config, max_gaussians=300), **quiet)
    if device == "cuda":
        torch.cuda.reset_peak_memory_stats()
    with recording(device) as profile:
        run = train(open_clip(folder / "clip"), folder / "run", config, **quiet)
    assert run is not None
    card = torch.cuda.max_memory_allocated() / 2**20 if device == "cuda" else None
    return seconds_of(profile) | {"gaussians": run.info["gaussians"], "memory": peak_memory(), "card": card}


def seconds_of(profile: Profile) -> dict[str, Cell]:
    """What a profile says of each of `COSTS`."""
    stages: dict[str, Cell] = {name: profile.within((name,)) for name in ("flow", "semantics", "save")}
    joint = profile.spent[("joint",)].calls
    return stages | {"step": 1e3 * profile.within(("joint",)) / joint, "whole": profile.seconds}


def exponent(sizes: Sequence[float], costs: Sequence[Cell]) -> float | None:
    """b of cost ∝ size^b, by least squares of the logarithms over the upper half of the sizes, at least three; None where one is unknown.

    What every training costs, however small, makes b smaller at the lower end.
    """
    upper = max(3, math.ceil(len(sizes) / 2))
    known = [float(cost) for cost in costs[-upper:] if isinstance(cost, int | float) and cost > 0]
    if len(known) < min(upper, len(sizes)) or len(known) < 2:
        return None
    return float(np.polyfit(np.log(sizes[-len(known) :]), np.log(known), 1)[0])


def _amount(what: str, size: Size) -> int:
    """How much of what grows there is."""
    return {"frames": size.frames, "pixels": math.prod(size.pixels), "Gaussians": size.gaussians, "classes": size.classes}[what]


def _table(what: str, ladder: Sequence[Size], rows: list[dict[str, Cell]]) -> Table:
    sizes = [_amount(what, size) for size in ladder]
    columns = {key: heading for key, heading in (COSTS | MEMORY).items() if any(row[key] is not None for row in rows)}
    fitted: dict[str, Cell] = {key: exponent(sizes, [row[key] for row in rows]) for key in columns}
    told: list[dict[str, Cell]] = [{"size": size, **row} for size, row in zip(sizes, rows, strict=True)]
    first = ladder[0]
    others = [f"{first.frames} frames"] * (what != "frames") + [f"{first.pixels[0]} × {first.pixels[1]} pixels"] * (what != "pixels")
    others += [f"at most {first.gaussians:,} Gaussians"] * (what != "Gaussians") + [f"{first.classes} classes"] * (what != "classes")
    return Table(
        f"growth-{what.lower()}",
        f"What a training costs with more {what}",
        f"All else alike: {', '.join(others)}. Preset quick with {STEPS} steps, as many of the semantic stage, exact labels and depth; "
        "frames are trained on at full size, optical flow has its own. Each in a process of its own, one training each; the memory is the "
        "most that the process held, interpreter and libraries included. Last row: b of cost ∝ size^b, fitted to the upper half.",
        [
            Column("size", what, 0),
            *([Column("gaussians", "Gaussians at the end", 0)] if what != "Gaussians" else []),
            *(Column(key, heading, 2 if key in COSTS else 0) for key, heading in columns.items()),
        ],
        [*told, {"size": "exponent b", **{key: value if value is None else f"{value:.2f}" for key, value in fitted.items()}}],
        curves=("size", *columns),
        logarithmic=True,
    )
