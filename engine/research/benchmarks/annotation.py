"""What correcting one frame is worth: labels propagated to all others, against exact ones."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping

import cv2
import numpy as np

from degense.engine.annotation.edits import Proposal
from degense.engine.annotation.propagation.propagate import propagate
from degense.engine.clip import Clip
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.events import Event, TrainingProgress
from degense.engine.metrics.masks import MaskScores
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train

INSTRUMENTS = ("grasper", "L-hook electrocautery")


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """One table: with a run that never saw a label, and along the motion of the clip alone."""
    size = (12, 160, 128) if options.quick else (40, 320, 256)
    short = {"iterations": 60, "max_gaussians": 3_000} if options.quick else {}
    table = Table(
        "annotation",
        "One corrected frame, propagated to all others",
        f"Phantoms of {size[0]} frames, {size[1]} × {size[2]}, of {len(options.seeds)} seeds. One frame, the one that shows most classes, "
        "is corrected to the truth; intersection over union of the other frames, the mean over classes of the mean over frames (a class "
        "predicted where the truth lacks it scores 0 there). The run is made with the preset quick and without any labels. Seconds: of the "
        "propagation alone. Confidence: what it says of itself, on average. Strokes: the connected regions of the corrected frame, each an "
        "outline or a fill for whoever labels it from nothing.",
        [
            Column("with", "propagated through"),
            Column("tissues", "tissues, IoU", 3, "mean"),
            Column("instruments", "instruments, IoU", 3, "mean"),
            Column("confidence", "confidence", 3, "mean"),
            Column("strokes", "strokes", 0),
            Column("seconds", "time, s", 0),
        ],
    )
    found: dict[str, list[tuple[float, ...]]] = {"the 4D field, flow and looks": [], "flow and looks": []}
    for done, seed in enumerate(options.seeds):

        def tell(fraction: float, message: str, done: int = done) -> None:
            progress((done + fraction) / len(options.seeds), message)

        clip, scene = _prepared(options, seed, size, short, tell)
        for (through, several), given in zip(found.items(), (scene, None), strict=True):
            tell(0.7 if given else 0.85, f"propagating through {through}")
            several.append(_measured(clip, given))
    for through, several in found.items():
        tissues, instruments, confidence, strokes, seconds = (list(column) for column in zip(*several, strict=True))
        row: dict[str, Cell] = {"with": through, "tissues": tissues, "instruments": instruments}
        table.rows.append(row | {"confidence": confidence, "strokes": strokes, "seconds": seconds})
    yield table


def _prepared(
    options: BenchOptions, seed: int, size: tuple[int, int, int], short: Mapping[str, int], progress: Progress
) -> tuple[Clip, Scene]:
    """A phantom and a run of it that saw no label."""
    folder, run_folder = options.scratch / f"annotation-{seed}", options.scratch / f"annotation-run-{seed}"
    frames, width, height = size
    make_phantom(folder, PhantomOptions(frames=frames, width=width, height=height, seed=seed), lambda f, words: progress(0.1 * f, words))
    clip = open_clip(folder)
    config = TrainConfig.preset_of("quick", device=options.device, seed=seed, **short)

    def tell(event: Event) -> None:
        if isinstance(event, TrainingProgress):
            progress(0.1 + 0.6 * event.iteration / event.iterations, "training")

    train(clip, run_folder, config, teacher="none", events=tell, stop=lambda: False)
    return clip, Scene.open(run_folder, device=options.device, clip=clip)


def _measured(clip: Clip, scene: Scene | None) -> tuple[float, float, float, float, float]:
    """IoU of tissues and of instruments, confidence, strokes, seconds."""
    source = most_shown(clip)
    labels = clip.labels(source)
    assert labels is not None
    start, proposals = time.perf_counter(), dict[int, Proposal]()
    steps = propagate(clip, {source: labels}, scene)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            proposals = end.value
            break
    seconds, scores = time.perf_counter() - start, MaskScores(clip.classes)
    for frame, found in proposals.items():
        truth = clip.labels(frame)
        assert truth is not None
        scores.add(found.labels, truth)
    by_class = scores.result()["iou"]
    assert isinstance(by_class, dict)
    tools, others = ([v for name, v in by_class.items() if v is not None and (name in INSTRUMENTS) is tool] for tool in (True, False))
    strokes = sum(cv2.connectedComponents((labels == value).astype(np.uint8))[0] - 1 for value in np.unique(labels))
    confidence = float(np.mean([found.confidence for found in proposals.values()]))
    return float(np.mean(others)), float(np.mean(tools)), confidence, strokes, seconds


def most_shown(clip: Clip) -> int:
    """The frame that shows most classes; of equal ones that in which the rarest covers most."""

    def shown(frame: int) -> tuple[int, int]:
        labels = clip.labels(frame)
        assert labels is not None
        areas = np.unique(labels, return_counts=True)[1]
        return len(areas), int(areas.min())

    return max(clip.labelled_frames, key=shown)
