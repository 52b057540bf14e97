"""What every teacher offers."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from degense.engine.semantics.text.encoder import TextEncoder

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
    encoder : TextEncoder
        Turns prompts into vectors that compare with the targets; the run keeps it.
    pixelwise : bool
        True: each pixel has its vector. False: a vector describes the area of its pixels as a whole, as a coarse feature map does.
    """

    name: str
    provenance: str
    frames: list[int]
    encoder: TextEncoder
    pixelwise: bool

    def targets(self, frame: int) -> Targets | None:
        """Vectors and index map of a frame, or None when the teacher says nothing about it."""
        ...
