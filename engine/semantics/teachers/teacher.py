"""What every teacher offers, and targets of a soft label map: every place a mixture of its two likeliest classes."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.text.encoder import TextEncoder

#: Unit vectors float32 [k, D], and int32 [H, W] that says which of them a pixel should have; −1 where there is no target.
Targets = tuple[np.ndarray, np.ndarray]
LEVELS = 8  # steps of a mixture of two classes, from half and half to the first class alone


class Described(Protocol):
    """What is known of a teacher."""

    name: str  # "labels", …
    provenance: str  # for the user: where the targets come from and on which frames
    frames: list[int]  # that have targets, ascending; never a held-out frame, unless the clip has no other
    encoder: TextEncoder  # turns prompts into vectors that compare with the targets; the run keeps it
    pixelwise: bool  # each pixel has its vector; else a vector describes the area of its pixels as a whole, as a coarse feature map does


class Teacher(Described, Protocol):
    """A source of unit feature vectors per pixel."""

    def targets(self, frame: int) -> Targets | None:
        """Vectors and index map of a frame, or None when it has no targets."""
        ...


def enlarged(cells: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A map [h, w] at (width, height): the cell that each pixel lies in."""
    (rows, columns), (width, height) = cells.shape, size
    y, x = (np.arange(height) + 0.5) * rows / height, (np.arange(width) + 0.5) * columns / width
    return cells[y.astype(int)[:, None], x.astype(int)]


def soft_targets(probabilities: np.ndarray, vectors: np.ndarray, known: np.ndarray) -> Targets:
    """Targets of a soft label map float [..., k], of which only proportions count, where it is `known`, bool [...].

    Of the classes' unit vectors [k, D] only mixtures that occur, float32 [m, D]: p · v_first + (1 − p) · v_second, of unit length, with p
    rounded to `LEVELS` steps.
    """
    count = len(vectors)
    if count == 1:
        return vectors, np.where(known, 0, -1).astype(np.int32)
    order = np.argpartition(probabilities, count - 2, axis=-1)[..., -2:]
    pair = np.take_along_axis(probabilities, order, -1)
    swap = pair[..., 0] > pair[..., 1]
    first, second = np.where(swap, order[..., 0], order[..., 1]), np.where(swap, order[..., 1], order[..., 0])
    share = pair.max(-1) / np.maximum(pair.sum(-1), 1e-12)
    level = np.clip(np.round((2 * share - 1) * LEVELS), 0, LEVELS).astype(np.int64)
    second = np.where(level == LEVELS, first, second)
    codes, places = np.unique(((first * count + second) * (LEVELS + 1) + level)[known], return_inverse=True)
    a, b, p = codes // (LEVELS + 1) // count, codes // (LEVELS + 1) % count, 0.5 + codes % (LEVELS + 1) / (2 * LEVELS)
    mixed = p[:, None] * vectors[a] + (1 - p)[:, None] * vectors[b]
    index = np.full(known.shape, -1, np.int32)
    index[known] = places
    return unit_rows(mixed).astype(np.float32), index
