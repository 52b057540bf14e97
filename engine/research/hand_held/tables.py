"""The tables: masks of a scene next to label maps that are copied or follow the flow, and labels that are carried."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

from degense.engine.annotation.propagation.propagate import propagate
from degense.engine.clip import UNLABELLED, Clip
from degense.engine.data.readers import open_clip, with_labels
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.events import Event, TrainingProgress
from degense.engine.progress import Progress, finish, silent
from degense.engine.research.baselines.clip_flow import ClipFlow, warped_filled
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Column, Table
from degense.engine.research.hand_held.scores import AnswerScores
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import decode_frame
from degense.engine.scene.labelled import LabelledPlaces
from degense.engine.semantics.prompts import PromptSet
from degense.engine.training import TrainConfig, train

CHOSEN, REPORTED = (21, 64, 84), (49, 70)  # develop surgeries of a hand-held camera: settings were chosen on the first ones
CAMERA = 8.0  # mm: amplitude of the camera's path; the surgeries draw 0.5 to 2.5
FRAMES, SCORED = 240, 8  # of a clip; evenly spread frames after the first, the last among them
#: From a frame to its label map uint8 [H, W].
Answer = Callable[[int], np.ndarray]

COLUMNS = [
    Column("surgery", "surgery"),
    Column("answer", "labels of the first frame"),
    Column("last", "tissue mIoU, last frame", 3),
    Column("pixels", "entered later, % of pixels", 1),
    Column("entered", "of it unlabelled, %", 1),
    Column("misnamed", "of it misnamed, %", 1),
    Column("new_pixels", "new classes, % of pixels", 1),
    Column("new", "of them unlabelled, %", 1),
    Column("both", "of both unlabelled, %", 1),
    Column("missed", "shown tissue unlabelled, %", 1),
]


def run(options: BenchOptions, progress: Progress = silent) -> Iterator[Table]:
    """Two tables: masks of scenes and of baselines, and carried labels."""
    frames, width, height = (16, 96, 80) if options.quick else (FRAMES, 160, 128)
    surgeries = CHOSEN[:1] if options.quick else CHOSEN + REPORTED
    config = TrainConfig.preset_of("quick", device=options.device, **({"iterations": 60, "max_gaussians": 3_000} if options.quick else {}))
    masks, carried = tables(surgeries, frames, width, height)
    for done, seed in enumerate(surgeries):

        def tell(fraction: float, words: str, done: int = done, seed: int = seed) -> None:
            progress((done + fraction) / len(surgeries), f"surgery {seed}: {words}")

        folder = options.scratch / f"hand-held-{seed}"
        make_phantom(folder, PhantomOptions(frames, width, height, seed, CAMERA, kind="family"), lambda f, words: tell(0.2 * f, words))
        clip, scene = open_clip(folder), trained(folder, config, lambda f, words: tell(0.2 + 0.5 * f, words))
        tell(0.7, "scoring masks")
        for name, answer in answers(clip, scene).items():
            masks.rows.append({"surgery": str(seed), "answer": name, **scored(clip, answer).cells()})
        for name, given in (("flow and looks", None), ("the 4D field, flow and looks", scene)):
            tell(0.8 if given is None else 0.9, f"carrying along {name}")
            carried.rows.append({"surgery": str(seed), "answer": name, **scored_carrying(clip, given).cells()})
    yield masks
    yield carried


def tables(surgeries: Sequence[int], frames: int, width: int, height: int) -> tuple[Table, Table]:
    """The tables without rows."""
    what = (
        f"Surgeries {', '.join(map(str, surgeries))} of the family ({', '.join(map(str, CHOSEN))}: of choosing), hand-held camera with a "
        f"path of {CAMERA:g} mm, {frames} frames, {width} × {height}, exact depth; only the first frame is labelled. Entered later: tissue "
        f"of a class that the first frame shows, at a place that it does not show. Scored on {SCORED} evenly spread frames; mIoU on tissue "
        "that the first frame shows."
    )
    masks = Table("hand-held-masks", "One labelled frame, a hand-held camera", f"{what} Scenes: preset quick.", COLUMNS)
    error = Column("error", "calibration error, %", 1)
    carried = Table(
        "hand-held-carrying",
        "Labels of one frame carried through a clip of a hand-held camera",
        f"{what} Calibration error: expected, of the chance that a pixel's label is right, in ten bins; what entered later and new classes "
        "are right where they are unlabelled.",
        [*COLUMNS, error],
    )
    return masks, carried


def trained(folder: Path, config: TrainConfig, progress: Progress) -> Scene:
    """A scene that was taught by the label map of the first frame alone, with the clip of all label maps."""
    first = folder.with_name(f"{folder.name}-first")
    (first / "labels").mkdir(parents=True)
    for name in ("classes.json", "labels/000000.png"):
        shutil.copyfile(folder / name, first / name)
    out = folder.with_name(f"{folder.name}-run")

    def tell(event: Event) -> None:
        if isinstance(event, TrainingProgress):
            progress(event.iteration / event.iterations, "training")

    train(with_labels(open_clip(folder), first), out, config, teacher="labels", events=tell, stop=lambda: False)
    return Scene.open(out, device=config.device, clip=open_clip(folder))


def scored_frames(clip: Clip) -> list[int]:
    """Those that are scored, ascending."""
    return np.linspace(0, len(clip) - 1, SCORED + 1).round().astype(int)[1:].tolist()


def answers(clip: Clip, scene: Scene) -> dict[str, Answer]:
    """What is compared: baselines; the masks of a scene of which every pixel may be named, or what the first frame shows; its masks."""
    labels, flow, asked = clip.labels(0), ClipFlow(clip), PromptSet(clip.classes)
    if labels is None:
        raise DegenseError(f"{clip.name} has no labels of its first frame.")
    first: np.ndarray = labels

    def followed(frame: int) -> tuple[np.ndarray, np.ndarray]:
        return warped_filled(first, flow.from_first[frame - 1][1])

    support = scene.run.load_label_support(len(scene.model))
    assert support is not None
    shown = LabelledPlaces(scene.states, support._replace(familiar=torch.zeros_like(support.familiar)), scene.cameras)

    def among(places: LabelledPlaces | None, frame: int) -> np.ndarray:
        kept, scene.renderer.labelled = scene.renderer.labelled, places
        scene.renderer.forget()
        try:
            return decode_frame(scene, asked, frame).labels
        finally:
            scene.renderer.labelled = kept
            scene.renderer.forget()

    return {
        "copied": lambda frame: first,
        "along chained flow": lambda frame: followed(frame)[0],
        "the same, unlabelled from outside the picture": lambda frame: np.where(
            followed(frame)[1], followed(frame)[0], np.uint8(UNLABELLED)
        ),
        "scene, every pixel may be named": lambda frame: among(None, frame),
        "scene, what the first frame shows": lambda frame: among(shown, frame),
        "scene": lambda frame: decode_frame(scene, asked, frame).labels,
    }


def scored(clip: Clip, answer: Answer) -> AnswerScores:
    """The scores of an answer."""
    scores = AnswerScores(clip)
    for frame in scored_frames(clip):
        scores.add(frame, answer(frame))
    return scores


def scored_carrying(clip: Clip, scene: Scene | None) -> AnswerScores:
    """The scores of the first frame's labels carried through the clip, with their chances."""
    first, scores, wanted = clip.labels(0), AnswerScores(clip), set(scored_frames(clip))
    assert first is not None

    def tell(frame: int, labels: np.ndarray, chances: np.ndarray) -> None:
        if frame in wanted:
            scores.add(frame, labels, chances)

    finish(propagate(clip, {0: first}, scene, tell=tell))
    return scores
