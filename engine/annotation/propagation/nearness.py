"""How much each of several corrected frames counts at another one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def nearness(frame: int, sources: Sequence[int]) -> np.ndarray:
    """Weights of sum 1, float32 [n], ∝ 1 / d² with d the distance in frames: the nearest says most, all agree in the end."""
    distance = np.abs(np.asarray(sources, np.float32) - frame)
    weights = 1 / np.maximum(distance, 0.5) ** 2
    return (weights / weights.sum()).astype(np.float32)
