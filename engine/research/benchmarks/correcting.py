"""Which frame to correct next: the one with the largest expected error, or evenly spaced ones; and whether that error is the true one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np

from degense.engine.annotation.edits import Proposal
from degense.engine.annotation.propagation.propagate import propagate
from degense.engine.clip import UNLABELLED, Clip
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.metrics.masks import MaskScores
from degense.engine.progress import Progress, finish
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.surgeries import DEVELOP

#: Of the family: on none of them was anything of the propagation fitted, and nothing is reported.
FIRST, SCENES = 48, 8
COUNTS = (1, 2, 3, 4, 6, 8)  # of corrected frames
BINS = 10
#: What was said and the share that is right, float [2, n] each.
Told = list[np.ndarray]


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Two tables: scores by number of corrected frames, and how often pixels, objects and frames of a confidence are right."""
    frames, width, height = (8, 96, 80) if options.quick else (24, 160, 128)
    scenes = DEVELOP[FIRST : FIRST + (1 if options.quick else SCENES)]
    counts = [count for count in COUNTS if count <= frames // 3]
    what = f"Surgeries {scenes[0]} to {scenes[-1]}, {frames} frames, {width} × {height}, exact labels carried along flow and looks"
    scores: dict[str, list[list[float]]] = {"by expected error": [], "evenly spaced": []}
    told: dict[str, Told] = {"pixels": [], "objects": [], "frames": []}
    for done, seed in enumerate(scenes):
        progress(done / len(scenes), f"surgery {seed}")
        folder = options.scratch / f"surgery-{seed}"
        make_phantom(folder, PhantomOptions(frames, width, height, seed, kind="family"), lambda fraction, words: None)
        clip = open_clip(folder)
        scores["by expected error"].append(corrected(clip, counts, most_doubtful, told))
        scores["evenly spaced"].append(corrected(clip, counts, evenly))
    table = Table(
        "correcting",
        "Frames that are corrected by expected error, and evenly spaced",
        f"{what}, to all frames. Mean IoU over all frames, those corrected count as right; means of the surgeries. By expected error: the "
        "middle frame first, then always the most doubtful one.",
        [Column("way", "corrected"), *(Column(str(count), f"{count} frame{'s' * (count > 1)}", 3, "mean") for count in counts)],
    )
    for way, of_scenes in scores.items():
        table.rows.append({"way": way} | {str(count): list(values) for count, *values in zip(counts, *of_scenes, strict=True)})
    yield table
    yield _reliability(what, {kind: np.concatenate(parts, 1) for kind, parts in told.items()})


def _reliability(what: str, told: dict[str, np.ndarray]) -> Table:
    table = Table(
        "reliability",
        "Whether the confidence of carried labels is the share that is right",
        f"{what} while they are corrected by expected error. Pixels: the chance that a label is right against the share that is. Objects: "
        "connected regions of a class, the mean chance in them against the share of their pixels that is right. Frames: expected IoU "
        "against the true one. Error: expected calibration error, over ten bins, of all.",
        [
            Column("kind", "of"),
            Column("bin", "confidence, %"),
            Column("count", "number", 0),
            Column("said", "said, %", 1),
            Column("right", "right, %", 1),
        ],
    )
    for kind, (said, right) in told.items():
        bins, error = np.minimum((said * BINS).astype(int), BINS - 1), 0.0
        for index in np.unique(bins):
            inside = bins == index
            means = [float(values[inside].mean()) for values in (said, right)]
            error += abs(means[0] - means[1]) * float(inside.mean())
            span = f"{100 * index // BINS} to {100 * (index + 1) // BINS}"
            row: dict[str, Cell] = {"kind": kind, "bin": span, "count": int(inside.sum()), "said": 100 * means[0], "right": 100 * means[1]}
            table.rows.append(row)
        table.rows.append({"kind": kind, "bin": "error", "count": len(said), "said": 100 * error, "right": None})
    return table


Choose = Callable[[int, int, dict[int, Proposal], Sequence[int]], list[int]]


def evenly(count: int, frames: int, proposals: dict[int, Proposal], chosen: Sequence[int]) -> list[int]:
    """`count` frames in the middles of equal parts of the clip."""
    return [int((k + 0.5) * frames / count) for k in range(count)]


def most_doubtful(count: int, frames: int, proposals: dict[int, Proposal], chosen: Sequence[int]) -> list[int]:
    """One more than `chosen`: the middle frame, then that with the largest expected error."""
    if not proposals:
        return evenly(1, frames, proposals, chosen)
    return [*chosen, min(proposals, key=lambda frame: (-proposals[frame].doubt, frame))]


def corrected(clip: Clip, counts: Sequence[int], choose: Choose, told: dict[str, Told] | None = None) -> list[float]:
    """Mean IoU over all frames for each number of corrected ones; `told` gets what was said of confidence, and what is right."""
    proposals: dict[int, Proposal] = {}
    chosen: list[int] = []
    found = []
    for count in range(1, max(counts) + 1):
        if choose is evenly and count not in counts:
            continue
        chosen = choose(count, len(clip), proposals, chosen)
        chances: dict[int, np.ndarray] = {}
        labels = {frame: _truth(clip, frame) for frame in chosen}
        proposals = finish(propagate(clip, labels, tell=lambda frame, _, chance, kept=chances: kept.update({frame: chance})))  # type: ignore[misc]
        scores = MaskScores(clip.classes)
        for frame in range(len(clip)):
            truth = _truth(clip, frame)
            scores.add(truth if frame in chosen else proposals[frame].labels, truth, clip.valid(frame))
        if count in counts:
            miou = scores.result()["miou"]
            assert isinstance(miou, float)
            found.append(miou)
        if told is not None:
            for frame, chance in chances.items():
                _tell(told, proposals[frame], chance, _truth(clip, frame), clip)
    return found


def _tell(told: dict[str, Told], proposal: Proposal, chance: np.ndarray, truth: np.ndarray, clip: Clip) -> None:
    labels = proposal.labels
    right = labels == truth
    named = labels != UNLABELLED
    told["pixels"].append(np.stack([chance[named], right[named]]).astype(np.float32))
    objects = []
    for value in np.unique(labels[named]):
        count, parts = cv2.connectedComponents((labels == value).astype(np.uint8))
        sizes = np.bincount(parts.ravel(), minlength=count)[1:]
        means = [np.bincount(parts.ravel(), values.ravel(), count)[1:] / sizes for values in (chance, right)]
        objects.append(np.stack(means))
    told["objects"] += objects
    scores = MaskScores(clip.classes)
    scores.add(labels, truth)
    miou = scores.result()["miou"]
    told["frames"].append(np.array([[proposal.confidence], [miou]], float))


def _truth(clip: Clip, frame: int) -> np.ndarray:
    labels = clip.labels(frame)
    if labels is None:
        raise DegenseError(f"{clip.name} has no labels of frame {frame}.")
    return labels
