"""How often each class is labelled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from degense.engine.clip import UNLABELLED


@dataclass(frozen=True)
class ClassCount:
    """One class over the labelled frames."""

    frames: int  # in which it is seen
    pixels: int  # in all of them
    share: float  # of all labelled pixels, in [0, 1]


def pixel_counts(labels: np.ndarray) -> np.ndarray:
    """Pixels of each value of a label map uint8 [H, W], int64 [256]."""
    return np.bincount(labels.ravel(), minlength=256)


def class_counts(counts: Mapping[int, np.ndarray], classes: int) -> list[ClassCount]:
    """For each class, from the pixel counts int64 [256] of each labelled frame."""
    table = np.array(list(counts.values()), np.int64).reshape(-1, 256)
    labelled = max(1, int(np.delete(table, UNLABELLED, 1).sum()))
    return [ClassCount(int((table[:, k] > 0).sum()), int(table[:, k].sum()), float(table[:, k].sum() / labelled)) for k in range(classes)]
