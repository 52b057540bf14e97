"""What every kind of phantom offers to the camera that photographs it, and motions that they share, of clip time s in [0, 1]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from degense.engine.data.synthetic.paint import smoothstep
from degense.engine.data.synthetic.tools import Tool

BREATHS = 3.0


@dataclass(frozen=True)
class Patch:
    """A connected grid of tissue."""

    rest: np.ndarray  # float64 [h, w, 3]; vertices at frame 0, mm, camera frame of frame 0
    texels: np.ndarray  # float64 [h, w, 2]; where each vertex lies on the texture (x, y), in texels


class PhantomStage(Protocol):
    """Tissue, what happens to it, and the tools, of one seed."""

    classes: tuple[str, ...]  # names of the labels
    palette: tuple[tuple[int, int, int], ...]  # a colour for each
    change: int  # how tissue changes its look: `render.CHARS` or `render.BLEEDS`
    changed_label: int  # what tissue is called that has
    change_time: float  # clip time that the change takes at one place
    texture: np.ndarray  # float32 [Ht, Wt, 8 or 9]
    organs: np.ndarray  # uint8 [Ht, Wt]
    patches: list[Patch]

    def displacements(self, s: float) -> list[np.ndarray]:
        """Offset of every vertex of every patch from its place at s = 0, mm, float64 [h, w, 3] each."""
        ...

    def tools(self, s: float) -> list[Tool]:
        """The instruments at clip time s."""
        ...


def breathing(s: float) -> float:
    """Inspiration, 0 to 1; 0 at s = 0."""
    return float(0.5 - 0.5 * np.cos(2 * np.pi * BREATHS * s))


def approach(s: float, arrive: tuple[float, float], leave: tuple[float, float] | None = None) -> float:
    """How far a tool is drawn back from where it works: 1 is out of view, 0 at work."""
    out = 1 - smoothstep((s - arrive[0]) / (arrive[1] - arrive[0]))
    if leave is not None:
        out = max(out, smoothstep((s - leave[0]) / (leave[1] - leave[0])))
    return float(out)
