"""What every kind of phantom offers to the camera that photographs it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from degense.engine.data.synthetic.tools import Tool


@dataclass(frozen=True)
class Patch:
    """A connected grid of tissue.

    Attributes
    ----------
    rest : float64 [h, w, 3]
        Vertices at frame 0, mm, camera frame of frame 0.
    texels : float64 [h, w, 2]
        Where each vertex lies on the texture (x, y), in texels.
    """

    rest: np.ndarray
    texels: np.ndarray


class PhantomStage(Protocol):
    """Tissue, what happens to it, and the tools, of one seed.

    Attributes
    ----------
    classes : tuple of str
        Names of the labels.
    palette : tuple of RGB
        A colour for each.
    change : int
        How tissue changes its look: `render.CHARS` or `render.BLEEDS`.
    changed_label : int
        What tissue is called that has.
    change_time : float
        Clip time that the change takes at one place.
    texture : float32 [Ht, Wt, 8 or 9]
    organs : uint8 [Ht, Wt]
    """

    classes: tuple[str, ...]
    palette: tuple[tuple[int, int, int], ...]
    change: int
    changed_label: int
    change_time: float
    texture: np.ndarray
    organs: np.ndarray
    patches: list[Patch]

    def displacements(self, s: float) -> list[np.ndarray]:
        """Offset of every vertex of every patch from its place at s = 0, mm, float64 [h, w, 3] each."""
        ...

    def tools(self, s: float) -> list[Tool]:
        """The instruments at clip time s."""
        ...
