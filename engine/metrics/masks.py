"""How well masks agree with annotated ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from degense.engine.clip import UNLABELLED
from degense.engine.metrics.averages import mean


def iou(predicted: np.ndarray, truth: np.ndarray) -> float | None:
    """Intersection over union of two masks, bool [H, W]: 0 when just one of them is empty, None when both are."""
    union = np.count_nonzero(predicted | truth)
    return np.count_nonzero(predicted & truth) / union if union else None


def boundary_f(predicted: np.ndarray, truth: np.ndarray, tolerance: float | None = None) -> float | None:
    """Boundary F-score (DAVIS): harmonic mean of the shares of either outline that lie within `tolerance` of the other.

    Outlines are the pixels of a mask bool [H, W] that touch, by an edge, a pixel outside it; the picture's border makes no outline. None
    when neither mask has one, 0 when just one of them has. `tolerance` is in pixels; by default 0.008 of the picture's diagonal, as DAVIS.
    """
    reach = 0.008 * float(np.hypot(*truth.shape)) if tolerance is None else tolerance
    outlines = [_outline(predicted), _outline(truth)]
    if not any(outline.any() for outline in outlines):
        return None
    if not all(outline.any() for outline in outlines):
        return 0.0
    precision, recall = (
        float((cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[outline] <= reach).mean())
        for outline, other in (outlines, outlines[::-1])
    )
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


@dataclass(frozen=True)
class Entry:
    """One class in one frame: its scores (None: counts for nothing), and numbers of pixels."""

    iou: float | None
    boundary: float | None
    true: int
    guessed: int
    counted: int


class MaskScores:
    """Scores of a clip's masks, frame by frame and class by class.

    Protocol
    --------
    - IoU of each class in each frame, over the pixels that the annotation says something about and that are valid.
    - A class that the truth lacks in a frame but that was predicted there scores 0 in it: false positives cost. A class that both lack
      does not count in that frame.
    - `miou` is the mean over classes of the mean over frames. A class that no frame has, in truth or prediction, does not count.
    - `miou_pairs` is the peers' average (SurgTPGS): over all pairs of frame and class that the truth has. False positives on absent
      classes are free there, and a class that is seen often weighs more.
    - `miou_present` averages as `miou`, over those pairs only: what `miou` would be if false positives on absent classes were free.
    - `false_positives` of a class: in how many of the frames that lack it (`absent`) it was predicted (`frames`), and the share of pixels
      it took there, averaged over all frames that lack it (`share`).
    - `boundary_f` is averaged as `miou`.
    - `floor` of a class is the IoU of the answer "everywhere", averaged over the frames that have the class.
    - `floor_answer` is the label map that says nothing: the class with the most pixels of all, everywhere. It is scored as any other.
    - Classes that are `skipped`, for example "background", are not scored.
    """

    def __init__(self, classes: Sequence[str], skipped: Sequence[str] = ()):
        self.classes = tuple(classes)
        self._entries: dict[int, list[Entry]] = {i: [] for i, name in enumerate(classes) if name not in skipped}

    def add(self, predicted: np.ndarray, truth: np.ndarray, valid: np.ndarray | None = None) -> None:
        """One frame of label maps, uint8 [H, W]; `UNLABELLED` in the prediction is no class, in the truth it is left out."""
        for i in self._entries:
            self.add_mask(i, predicted == i, truth, valid)

    def add_masks(self, predicted: np.ndarray, truth: np.ndarray, valid: np.ndarray | None = None) -> None:
        """One frame: the mask of each class, bool [n, H, W], which may overlap, and the true label map."""
        for i in self._entries:
            self.add_mask(i, predicted[i], truth, valid)

    def add_mask(self, index: int, predicted: np.ndarray, truth: np.ndarray, valid: np.ndarray | None = None) -> None:
        """One class in one frame: its predicted mask, bool [H, W] (masks of several classes may overlap), and the true label map."""
        counted = truth != UNLABELLED if valid is None else (truth != UNLABELLED) & valid
        right, guess = (truth == index) & counted, predicted & counted
        sizes = (int(np.count_nonzero(mask)) for mask in (right, guess, counted))
        self._entries[index].append(Entry(iou(guess, right), boundary_f(guess, right), *sizes))

    def result(self) -> dict[str, Any]:
        """`miou`, `miou_pairs`, `miou_present`, `boundary_f`, `floor_answer`; by class name `iou`, `boundary`, `floor`, `false_positives`.

        `iou_frames` has, by class name too, one IoU a frame: None where the class does not count.
        """
        named = {self.classes[i]: entries for i, entries in self._entries.items()}
        present = {name: [e for e in entries if e.true] for name, entries in named.items()}
        overall = {name: mean(e.iou for e in entries) for name, entries in named.items()}
        boundary = {name: mean(e.boundary for e in entries) for name, entries in named.items()}
        return {
            "miou": mean(overall.values()),
            "miou_pairs": mean(e.iou for entries in present.values() for e in entries),
            "miou_present": mean(mean(e.iou for e in entries) for entries in present.values()),
            "boundary_f": mean(boundary.values()),
            "floor_answer": _floor_answer(named),
            "iou": overall,
            "iou_frames": {name: [e.iou for e in entries] for name, entries in named.items()},
            "boundary": boundary,
            "floor": {name: mean(e.true / e.counted for e in entries) for name, entries in present.items()},
            "false_positives": {name: _false_positives([e for e in entries if not e.true]) for name, entries in named.items()},
        }


def _false_positives(absent: list[Entry]) -> dict[str, float | None]:
    taken = [e.guessed / e.counted for e in absent if e.counted]
    return {"frames": sum(share > 0 for share in taken), "absent": len(taken), "share": mean(taken)}


def _floor_answer(named: dict[str, list[Entry]]) -> dict[str, Any]:
    """Name of the largest class, and `miou` and `miou_pairs` of saying it everywhere."""
    sizes = {name: sum(e.true for e in entries) for name, entries in named.items()}
    if not any(sizes.values()):
        return {"class": None, "miou": None, "miou_pairs": None}
    largest = max(sizes, key=lambda name: sizes[name])

    def scores(name: str, entries: list[Entry]) -> list[float]:
        if name == largest:
            return [e.true / e.counted for e in entries if e.counted]  # 0 where the frame lacks it
        return [0.0 for e in entries if e.true]

    found = {name: scores(name, entries) for name, entries in named.items()}
    pairs = [value for name, entries in named.items() for value in scores(name, [e for e in entries if e.true])]
    return {"class": largest, "miou": mean(mean(values) for values in found.values()), "miou_pairs": mean(pairs)}


def _outline(mask: np.ndarray) -> np.ndarray:
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    return mask & (cv2.erode(mask.astype(np.uint8), cross, borderType=cv2.BORDER_CONSTANT, borderValue=1) == 0)
