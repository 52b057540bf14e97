"""What a vector says is its direction."""

from __future__ import annotations

import numpy as np

LEAST = 1e-12  # a shorter vector says nothing and stays about zero


def unit_rows(vectors: np.ndarray) -> np.ndarray:
    """Vectors [..., D] at unit length, of the same float type; those of no length stay."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), LEAST)
