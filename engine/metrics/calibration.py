"""Whether the threshold of a mask is well chosen, and whether a similarity, or the confidence shown beside a mask, is a probability."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from degense.engine.clip import UNLABELLED
from degense.engine.metrics.averages import Mean
from degense.engine.semantics.masks.confidence import MARGINS_AS_CHANCES, ConfidenceCurve

STEPS = 100  # thresholds 0, 1/100, …, 99/100
BINS = 10  # of the reliability diagram


class Calibration:
    """What every threshold would give, and how often pixels of a similarity truly belong to the class.

    Protocol
    --------
    - The mask of a class at threshold τ is {similarity > τ}, for each class by itself, pixel by pixel: no class
      competes, masks may overlap, and nothing is cleaned up afterwards.
    - IoU is averaged as `MaskScores.miou`: the mean over classes of the mean over frames; a mask of a class that the frame lacks scores 0,
      and an empty one does not count.
    - The best threshold is the one with the largest mean; it is chosen on the very frames it is scored on, so what it gains over the
      default is an upper bound of what calibration can gain.
    - Reliability: over all pairs of a pixel and a class, in bins of similarity (below 0 counts as 0, above 1 as 1), the mean similarity
      against the share that truly has the class. `error` is their mean absolute difference, weighted by pairs (expected
      calibration error). It measures how far a cosine is from a probability.
    - Classes that are `skipped` are not scored.
    """

    def __init__(self, classes: Sequence[str], skipped: Sequence[str] = ()):
        self.classes = tuple(classes)
        self._right: dict[int, list[np.ndarray]] = {i: [] for i, name in enumerate(classes) if name not in skipped}
        self._wrong: dict[int, list[np.ndarray]] = {i: [] for i in self._right}
        self._sums = np.zeros((3, BINS))  # pairs, similarity, truth

    @property
    def scored(self) -> list[int]:
        """Indices of the classes that count."""
        return list(self._right)

    def add(self, index: int, similarity: np.ndarray, truth: np.ndarray, valid: np.ndarray | None = None) -> None:
        """One class in one frame: its similarity, float [H, W], and the true label map, uint8 [H, W]."""
        counted = truth != UNLABELLED if valid is None else (truth != UNLABELLED) & valid
        value, has = np.clip(similarity[counted].astype(np.float64), 0.0, 1.0), truth[counted] == index
        above = np.clip(np.ceil(value * STEPS).astype(int), 0, STEPS)  # lies above the thresholds 0 … above − 1
        for kept, which in ((self._right, has), (self._wrong, ~has)):
            kept[index].append(np.bincount(above[which], minlength=STEPS + 1)[::-1].cumsum()[::-1])
        place = np.minimum((value * BINS).astype(int), BINS - 1)
        for row, weight in enumerate((None, value, has)):
            self._sums[row] += np.bincount(place, weight, BINS)

    def curve(self, index: int) -> np.ndarray | None:
        """Mean IoU of a class over frames at each threshold, float64 [`STEPS`]; NaN where no frame counts, None when none was added."""
        if not self._right[index]:
            return None
        right, wrong = (np.stack(kept[index]) for kept in (self._right, self._wrong))
        union = right[:, :1] + wrong[:, 1:]
        iou = np.where(union > 0, right[:, 1:] / np.maximum(union, 1), 0.0)
        counts = (union > 0).sum(0)
        return np.where(counts > 0, iou.sum(0) / np.maximum(counts, 1), np.nan)

    def result(self, default: float) -> dict[str, Any]:
        """`default` and `best` threshold with `miou_default` and `miou_best`, `best_of` each class, `curve`, `reliability`, `error`."""
        curves = {i: curve for i in self._right if (curve := self.curve(i)) is not None and np.isfinite(curve).any()}
        if not curves:
            return {"default": default, "best": None, "miou_default": None, "miou_best": None, "best_of": {}, "curve": []} | {
                "reliability": [],
                "error": None,
            }
        stacked = np.stack(list(curves.values()))
        known = np.isfinite(stacked)
        mean = np.where(known, stacked, 0.0).sum(0) / np.maximum(known.sum(0), 1)
        best = int(mean.argmax())
        best_of = {self.classes[i]: [int(np.nanargmax(c)) / STEPS, float(np.nanmax(c))] for i, c in curves.items()}
        return {
            "default": default,
            "best": best / STEPS,
            "miou_default": float(mean[min(round(default * STEPS), STEPS - 1)]),
            "miou_best": float(mean[best]),
            "best_of": best_of,
            "curve": [[k / STEPS, float(mean[k])] for k in range(0, STEPS, 5)],
            **self._reliability(),
        }

    def _reliability(self) -> dict[str, Any]:
        pairs, similarity, truth = self._sums
        error, bins = Mean(), []
        for n, s, t in zip(pairs, similarity, truth, strict=True):
            if n:
                bins.append({"similarity": float(s / n), "share": float(t / n), "pairs": int(n)})
                error.add(abs(s - t) / n, n)
        return {"reliability": bins, "error": error.value}


class Reliability:
    """How often what is said with some confidence is right, in `BINS` bins of the confidence."""

    def __init__(self) -> None:
        self._sums = np.zeros((3, BINS))  # number, confidence, right

    def add(self, said: np.ndarray, right: np.ndarray) -> None:
        """Confidences in [0, 1], and whether they, or which share of each, are right: float [n] both."""
        place = np.minimum((said * BINS).astype(int), BINS - 1)
        for row, weight in enumerate((None, said, right)):
            self._sums[row] += np.bincount(place, weight, BINS)

    def result(self) -> dict[str, Any]:
        """`reliability`, for each bin that has any their `number` and the means of `said` and `right`; `error`, the expected calibration
        error: the mean absolute difference of the two means, weighted by the numbers, None without any."""
        error, bins = Mean(), []
        for n, said, right in zip(*self._sums, strict=True):
            if n:
                bins.append({"number": int(n), "said": float(said / n), "right": float(right / n)})
                error.add(abs(said - right) / n, n)
        return {"reliability": bins, "error": error.value}


class ConfidenceCalibration:
    """Whether the confidence of masks is the share of them that is right: of each mask, of its pixels, and of its objects.

    One pair for each non-empty mask: its confidence, which the window shows, and the share of its pixels, of those that count, that truly
    have the class. `error` is the mean absolute difference of the two, `excess` the mean by which the confidence is higher. `pixels` and
    `objects`, the connected parts of masks, have reliability diagrams (`Reliability`).
    """

    def __init__(self) -> None:
        self._confidence, self._right, self._error = Mean(), Mean(), Mean()
        self._pixels, self._objects = Reliability(), Reliability()

    def add(
        self,
        chances: np.ndarray,
        mask: np.ndarray,
        index: int,
        truth: np.ndarray,
        valid: np.ndarray,
        curve: ConfidenceCurve = MARGINS_AS_CHANCES,
    ) -> None:
        """One mask bool [H, W] of the class `index`, the chance of each of its pixels to be right float [H, W], the true label map uint8
        [H, W], the pixels that count, bool [H, W], and the run's curve."""
        counted = mask & valid & (truth != UNLABELLED)
        if not counted.any():
            return
        confidence, right = curve.of_mask(chances, mask), float((truth[counted] == index).mean())
        self._confidence.add(confidence)
        self._right.add(right)
        self._error.add(abs(confidence - right))
        said, right_at = chances[counted].astype(np.float64), truth[counted] == index
        self._pixels.add(said, right_at)
        count, parts = cv2.connectedComponents(mask.astype(np.uint8))
        sizes, *sums = (np.bincount(parts[counted], weight, count)[1:] for weight in (None, said, right_at))
        some = sizes > 0
        said, right_share = (of_part[some] / sizes[some] for of_part in sums)
        self._objects.add(curve.of_objects(said, np.bincount(parts[mask], minlength=count)[1:][some] / mask.size), right_share)

    def result(self) -> dict[str, Any]:
        """`masks`, how many; means of `confidence` and `precision`; `error`, `excess`; `pixels`, `objects`. None where no mask counts."""
        confidence, right = self._confidence.value, self._right.value
        excess = confidence - right if confidence is not None and right is not None else None
        found = {"confidence": confidence, "precision": right, "error": self._error.value, "excess": excess}
        return {"masks": int(self._error.weight), **found, "pixels": self._pixels.result(), "objects": self._objects.result()}
