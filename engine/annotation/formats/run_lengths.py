"""Masks as lengths of runs, zeros first: what COCO and CVAT write."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def run_lengths(flat: np.ndarray) -> list[int]:
    """Lengths of the runs of a bool [n], beginning with one of zeros, which may be empty."""
    changes = np.flatnonzero(np.diff(flat)) + 1
    lengths = np.diff(np.concatenate([[0], changes, [flat.size]])).tolist()
    return [0, *lengths] if flat.size and flat[0] else lengths


def from_run_lengths(lengths: Sequence[int], size: int) -> np.ndarray:
    """bool [size]; ValueError when the lengths are no whole numbers or do not add up to it."""
    runs = np.asarray(lengths)
    if runs.ndim != 1 or not np.issubdtype(runs.dtype, np.integer) or (runs < 0).any() or (runs > size).any() or runs.sum() != size:
        raise ValueError(f"run lengths that do not add up to {size} pixels")
    return np.repeat(np.arange(len(runs)) % 2 == 1, runs)
