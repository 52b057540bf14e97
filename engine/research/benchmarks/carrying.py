"""What carrying labels does with content that the labelled frame does not show, and whether its confidence is right."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from degense.engine.annotation.propagation.propagate import propagate
from degense.engine.clip import UNLABELLED, Clip
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.surgeries import DEVELOP

#: Surgeries of the family on which the weights of `votes.UNKNOWN` were not fitted, and nothing is reported.
FIRST, SCENES = 32, 16
BINS = 10


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """One table: a row for each surgery, and one for all."""
    frames, width, height = (8, 96, 80) if options.quick else (24, 160, 128)
    scenes = DEVELOP[FIRST : FIRST + (2 if options.quick else SCENES)]
    table = Table(
        "carrying",
        "The labels of the first frame, carried to all others",
        f"Surgeries {scenes[0]} to {scenes[-1]} of the family, {frames} frames, {width} × {height}, along flow and looks alone. Flagged: "
        "share of the pixels of classes that the first frame does not show which stay unlabelled. Missed: share of the other pixels that "
        "stay unlabelled. Calibration error: expected, of the chance that a pixel's label is right, in ten bins.",
        [
            Column("surgery", "surgery"),
            Column("new", "new content, % of pixels", 1),
            Column("flagged", "flagged, %", 1),
            Column("missed", "missed, %", 1),
            Column("right", "right, %", 1),
            Column("error", "calibration error, %", 1),
        ],
    )
    told: list[np.ndarray] = []
    for done, seed in enumerate(scenes):
        progress(done / len(scenes), f"surgery {seed}")
        folder = options.scratch / f"surgery-{seed}"
        make_phantom(folder, PhantomOptions(frames, width, height, seed, kind="family"), lambda fraction, words: None)
        told.append(carried(open_clip(folder)))
        table.rows.append({"surgery": str(seed), **figures(told[-1])})
    table.rows.append({"surgery": "all", **figures(np.concatenate(told, 1))})
    yield table


def carried(clip: Clip) -> np.ndarray:
    """Of all pixels that are carried: whether their content is new, left unlabelled, and right, and with what chance, float32 [4, n]."""
    first, found = clip.labels(0), []
    if first is None:
        raise DegenseError(f"{clip.name} has no labels of its first frame.")

    def tell(frame: int, labels: np.ndarray, chances: np.ndarray) -> None:
        truth, valid = clip.labels(frame), clip.valid(frame)
        assert truth is not None
        new, bare = ~np.isin(truth, first), labels == UNLABELLED
        right = np.where(new, bare, labels == truth)
        found.append(np.stack([new[valid], bare[valid], right[valid], chances[valid]]).astype(np.float32))

    for _ in propagate(clip, {0: first}, tell=tell):
        pass
    return np.concatenate(found, 1)


def figures(told: np.ndarray) -> dict[str, Cell]:
    """The columns of a row, from what `carried` returns."""
    new, bare, right, chance = told[0] > 0, told[1] > 0, told[2], told[3]
    shown: dict[str, Cell] = {
        "new": 100 * float(new.mean()),
        "flagged": 100 * float(bare[new].mean()) if new.any() else None,
        "missed": 100 * float(bare[~new].mean()),
    }
    return {**shown, "right": 100 * float(right.mean()), "error": 100 * calibration_error(chance, right)}


def calibration_error(chance: np.ndarray, right: np.ndarray) -> float:
    """Σ over bins of chance of their share times |mean chance − share that is right|."""
    bins = np.minimum((chance * BINS).astype(int), BINS - 1)
    each = [(bins == index) for index in range(BINS) if (bins == index).any()]
    return float(sum(inside.mean() * abs(chance[inside].mean() - right[inside].mean()) for inside in each))
