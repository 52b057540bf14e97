"""What a teacher's answers, and labels followed by optical flow, give on held-out frames without any scene: baselines of masks."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.metrics.masks import MaskScores
from degense.engine.metrics.semantics import NOT_SCORED
from degense.engine.progress import Progress
from degense.engine.research.baselines.clip_flow import ClipFlow, warped_filled
from degense.engine.semantics.teachers import Teacher, teacher_by_name, with_cached_targets

WINDOW = 8  # frames to each side that a vote looks at, beside the vote over the whole clip
INCONSISTENT = 0.2  # weight of a vote whose flow is not consistent forwards and backwards
OUTSIDE = 1e-6  # weight of a vote from outside the picture: it counts where there is no other

Labels = Mapping[int, np.ndarray]  # by frame, uint8 [H, W], `UNLABELLED` where a teacher says nothing
Vote = tuple[np.ndarray, "np.ndarray | np.float32"]  # labels uint8 [H, W] and their weight, of each pixel or of all


def teacher_labels(teacher: Teacher, clip: Clip, frames: list[int]) -> dict[int, np.ndarray]:
    """The teacher's answers as label maps: each vector becomes the class whose text vector is nearest."""
    classes, found = teacher.encoder.encode(list(clip.classes)), {}
    for frame in frames:
        answer = teacher.targets(frame)
        if answer is not None:
            vectors, index = answer
            nearest = np.append((vectors @ classes.T).argmax(1), UNLABELLED)
            found[frame] = nearest[index].astype(np.uint8)  # −1, nothing, is the last
    return found


def mask_baselines(clip: Clip, name: str, flow: ClipFlow, progress: Progress) -> dict[str, dict[str, Any]]:
    """Scores of all baselines of masks for a teacher, on the held-out frames that have a label map.

    - "teacher": its answer on the nearest training frame, as it is. "teacher, held-out frame shown": its answer when it is shown the
      held-out frame itself, as a segmenter of single frames is. Not for the teacher "labels", whose answer there is the truth.
    - "majority vote": in each pixel the commonest answer over the training frames; "…, ±8 frames": over those near by.
    - "majority vote along flow": the same, after each answer was warped to the held-out frame by chained optical flow.
    - "propagated mask": the teacher's answer on its first frame, followed by optical flow; "propagated mask, exact": the true label map
      of that frame, as if somebody had drawn it.
    """
    scored = [frame for frame in clip.test_frames if frame in set(clip.labelled_frames)]
    teacher = with_cached_targets(teacher_by_name(name, clip), progress)
    known = teacher_labels(teacher, clip, [frame for frame in teacher.frames if frame not in scored])
    if not scored or not known:
        return {}
    first, count = min(known), len(clip.classes)
    answers: dict[str, Callable[[int], np.ndarray | None]] = {
        "teacher": lambda frame: known[nearest(frame, list(known))],
        "majority vote": lambda frame: vote(known, count),
        f"majority vote, ±{WINDOW} frames": lambda frame: vote(near(known, frame), count),
        "majority vote along flow": lambda frame: vote_along(flow, frame, known, count),
        f"majority vote along flow, ±{WINDOW} frames": lambda frame: vote_along(flow, frame, near(known, frame), count),
        "propagated mask": lambda frame: propagated(flow, frame, first, known[first]),
    }
    exact = clip.labels(first)
    if exact is not None and name != "labels":
        answers["propagated mask, exact"] = lambda frame: propagated(flow, frame, first, exact)
    if name != "labels":
        shown = teacher_labels(with_cached_targets(teacher_by_name(name, nothing_held_out(clip)), progress), clip, scored)
        if len(shown) == len(scored):
            answers["teacher, held-out frame shown"] = shown.get
    return {name: score_labels(clip, scored, answer) for name, answer in answers.items()}


def score_labels(clip: Clip, frames: list[int], answer: Callable[[int], np.ndarray | None]) -> dict[str, Any]:
    """Scores of label maps under the keys of `evaluate`, where "labels" stands for the decoder."""
    scores = MaskScores(clip.classes, NOT_SCORED)
    for frame in frames:
        truth, predicted = clip.labels(frame), answer(frame)
        assert truth is not None
        assert predicted is not None
        scores.add(predicted, truth, clip.valid(frame))
    found = scores.result()
    return {"miou": {"labels": found["miou"]}, "boundary_f": found["boundary_f"], "masks": {"labels": found}, "mask_frames": frames}


def nearest(frame: int, frames: list[int]) -> int:
    """The nearest of some frames; of two that are as near, the earlier one."""
    return min(frames, key=lambda other: (abs(other - frame), other))


def near(known: Labels, frame: int) -> Labels:
    """Those within `WINDOW` frames, or the nearest one when there are none."""
    return {i: labels for i, labels in known.items() if abs(i - frame) <= WINDOW} or {i: known[i] for i in [nearest(frame, list(known))]}


def vote(known: Labels, count: int) -> np.ndarray:
    """In each pixel the commonest label of `count` classes, the first of equally common ones; `UNLABELLED` where no map says anything."""
    return _winners(((labels, np.float32(1)) for labels in known.values()), next(iter(known.values())).shape, count)


def vote_along(flow: ClipFlow, frame: int, known: Labels, count: int) -> np.ndarray:
    """As `vote`, of labels warped to a frame; those along inconsistent flow count less, those from outside the picture hardly."""

    def moved() -> Iterator[Vote]:
        for source, (way, sure) in flow.chained(frame, list(known)).items():
            labels, inside = warped_filled(known[source], way)
            yield labels, np.where(inside, np.where(sure, 1.0, INCONSISTENT), OUTSIDE).astype(np.float32)

    return _winners(moved(), next(iter(known.values())).shape, count)


def propagated(flow: ClipFlow, frame: int, first: int, labels: np.ndarray) -> np.ndarray:
    """A label map of one frame as a 2D tracker carries it to another; without any drift when it begins at the clip's first frame."""
    way = flow.from_first[frame - 1][1] if first == 0 and frame > 0 else flow.chained(frame, [first])[first][0]
    return warped_filled(labels, way)[0]


def nothing_held_out(clip: Clip) -> Clip:
    """The same clip, all of whose frames a teacher may answer on."""
    shown = copy.copy(clip)
    shown.__class__ = type(type(clip).__name__, (type(clip),), {"test_frames": property(lambda self: [])})
    return shown


def _winners(votes: Iterable[Vote], shape: tuple[int, ...], count: int) -> np.ndarray:
    """The label of greatest weight in each pixel, of pairs of a label map and weights; `UNLABELLED` where there is none."""
    total = np.zeros((count, *shape), np.float32)
    for labels, weight in votes:
        for index in range(count):
            total[index] += (labels == index) * weight
    return np.where(total.any(0), total.argmax(0), UNLABELLED).astype(np.uint8)
