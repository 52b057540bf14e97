"""Scores of label maps on tissue that the first frame shows, and on what entered later."""

from __future__ import annotations

import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.metrics.averages import mean
from degense.engine.metrics.masks import iou
from degense.engine.research.bench.table import Cell
from degense.engine.research.benchmarks.carrying import calibration_error
from degense.engine.research.hand_held.shown import shown_at_first
from degense.engine.vocabulary import instruments

#: Kinds of pixels: tissue that the first frame shows, of a class that it shows; such tissue that it does not show; classes that it lacks.
SHOWN, ENTERED, NEW, OTHER = range(4)


class AnswerScores:
    """Of label maps of several frames of a phantom whose first frame is labelled.

    - `last`: mean over the tissues of the first frame of their IoU on the `SHOWN` pixels of the frame that was added last.
    - `entered`, `new`, `both`: pixels of these kinds, and of either, that are left unlabelled, of all frames; `misnamed`: `ENTERED` pixels
      that are neither that nor named right. None where there are no such pixels. `pixels`, `new_pixels`: how many of all pixels they are.
    - `missed`: `SHOWN` pixels that are left unlabelled.
    - `error`: expected calibration error of the chance that an answer is right. Right is an `ENTERED` or `NEW` pixel that is unlabelled,
      and another that has its class. None without chances.
    """

    def __init__(self, clip: Clip):
        truth, first = clip.truth(), clip.labels(0)
        assert truth is not None
        assert first is not None
        self._clip, self._truth, self._first = clip, truth, first
        self._tools, self._last = instruments(clip.classes), 0.0
        self._told: list[np.ndarray] = []

    def kinds(self, frame: int) -> np.ndarray:
        """The kind of each pixel, int [H, W]."""
        tissue, shown = shown_at_first(self._clip, self._truth, frame)
        labels = self._labels(frame)
        known = np.isin(labels, self._first) & ~np.isin(labels, self._tools)
        kinds = np.where(known & tissue, np.where(shown, SHOWN, ENTERED), OTHER)
        return np.where(np.isin(labels, self._first), kinds, NEW)

    def add(self, frame: int, answer: np.ndarray, chances: np.ndarray | None = None) -> None:
        """A label map uint8 [H, W], and the chance of each pixel to be right, float [H, W]."""
        kinds, labels = self.kinds(frame), self._labels(frame)
        shown, bare, named = kinds == SHOWN, answer == UNLABELLED, answer == labels
        found = [iou((answer == value) & shown, (labels == value) & shown) for value in np.unique(labels[shown])]
        self._last = mean(found) or 0.0
        said = np.full(kinds.shape, np.nan) if chances is None else chances
        self._told.append(np.stack([kinds, bare, named, said]).reshape(4, -1).astype(np.float32))

    def cells(self) -> dict[str, Cell]:
        """The scores, percentages but `last`."""
        kinds, bare, named, said = np.concatenate(self._told, 1)
        entered, new = kinds == ENTERED, kinds == NEW
        right = np.where(entered | new, bare, named)
        return {
            "last": self._last,
            "pixels": 100 * float(entered.mean()),
            "entered": _percent(bare, entered),
            "misnamed": _percent((bare == 0) & (named == 0), entered),
            "new_pixels": 100 * float(new.mean()),
            "new": _percent(bare, new),
            "both": _percent(bare, entered | new),
            "missed": _percent(bare, kinds == SHOWN),
            "error": None if np.isnan(said).any() else 100 * calibration_error(said, right),
        }

    def _labels(self, frame: int) -> np.ndarray:
        labels = self._clip.labels(frame)
        assert labels is not None
        return labels


def _percent(values: np.ndarray, where: np.ndarray) -> float | None:
    return 100 * float(values[where].mean()) if where.any() else None
