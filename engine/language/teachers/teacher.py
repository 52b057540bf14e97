"""What every teacher offers."""

from __future__ import annotations

from typing import Protocol

import numpy as np

#: Unit vectors float32 [k, D], and int32 [H, W] that says which of them a pixel should have; −1 where the teacher says nothing.
Targets = tuple[np.ndarray, np.ndarray]


class Teacher(Protocol):
    """A source of unit feature vectors per pixel.

    Attributes
    ----------
    name : str
        "labels", …
    provenance : str
        In words for the user: where the targets come from and on which frames.
    frames : list of int
        Frames that have targets, ascending; never a held-out frame, unless the clip has no other.
    """

    name: str
    provenance: str
    frames: list[int]

    def targets(self, frame: int) -> Targets | None:
        """Vectors and index map of a frame, or None when the teacher says nothing about it."""
        ...
