"""What every kind of phantom offers to the camera that photographs it, and motions that they share, of clip time s in [0, 1]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from degense.engine.data.synthetic.paint import smoothstep
from degense.engine.data.synthetic.tools import Tool

BREATHS = 3.0


@dataclass(frozen=True)
class Patch:
    """A connected grid of tissue."""

    rest: np.ndarray  # float64 [h, w, 3]; vertices at frame 0, mm, camera frame of frame 0
    texels: np.ndarray  # float64 [h, w, 2]; where each vertex lies on the texture (x, y), in texels


@dataclass(frozen=True)
class Optics:
    """Light, air and exposure at one clip time."""

    falloff: float = 2.0  # power of the distance with which light falls
    gleam: float = 1.0  # strength of highlights
    exposure: float = 1.0  # factor of all light
    smoke: float = 0.0  # share of it where it is thickest
    drifted: tuple[float, float] = (0.0, 0.0)  # how far the smoke has drifted, of the width


class PhantomStage(Protocol):
    """Tissue, what happens to it, and the tools, of one seed."""

    classes: tuple[str, ...]  # names of the labels
    palette: tuple[tuple[int, int, int], ...]  # a colour for each
    change: int  # how tissue changes its look, where the texture does not say: `render.CHARS` or `render.BLEEDS`
    changed_labels: tuple[int, int]  # what charred and what bled tissue is called
    change_time: float  # clip time that the change takes at one place, where the texture does not say
    texture: np.ndarray  # float32 [Ht, Wt, 8, 9 or 11]
    organs: np.ndarray  # uint8 [Ht, Wt]
    patches: list[Patch]

    noise: float | None  # of its camera, grey levels; None: as `PhantomOptions` says
    jpeg: int  # quality of the compression that its frames go through; 100 is none
    facts: dict[str, Any]  # what it shows, for `surgery.json`

    def __init__(self, half: tuple[float, float], cells: int, seed: int):
        """`half` is the half extent in x and y, material mm; `cells` are the mesh cells across the width."""
        ...

    @staticmethod
    def margin(seed: int, camera_motion: float) -> float:
        """How much wider than the view the tissue is."""
        ...

    def displacements(self, s: float) -> list[np.ndarray]:
        """Offset of every vertex of every patch from its place at s = 0, mm, float64 [h, w, 3] each."""
        ...

    def tools(self, s: float) -> list[Tool]:
        """The instruments at clip time s."""
        ...

    def optics(self, s: float) -> Optics:
        """Light and lens at clip time s."""
        ...

    def viewmat(self, s: float, amplitude: float) -> np.ndarray:
        """World to camera, float64 [4, 4], the identity at s = 0; `amplitude`, mm, is what was asked for."""
        ...


def sway(amplitude: float, s: float) -> np.ndarray:
    """World to camera, float64 [4, 4], of a camera that sways by `amplitude` mm; the identity at s = 0."""
    turn = 2 * np.pi * s
    return looking(amplitude * np.array([np.sin(turn), 0.6 * np.sin(2 * turn), 0.35 * (1 - np.cos(turn))]))


def looking(centre: np.ndarray) -> np.ndarray:
    """World to camera, float64 [4, 4], of a camera at `centre` mm that follows its own motion by a third."""
    forward = np.array([0.35 * centre[0], 0.35 * centre[1], 90.0]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    viewmat = np.eye(4)
    viewmat[:3, :3], viewmat[:3, 3] = rotation, -rotation @ centre
    return viewmat


def breathing(s: float) -> float:
    """Inspiration, 0 to 1; 0 at s = 0."""
    return float(0.5 - 0.5 * np.cos(2 * np.pi * BREATHS * s))


def approach(s: float, arrive: tuple[float, float], leave: tuple[float, float] | None = None) -> float:
    """How far a tool is drawn back from where it works: 1 is out of view, 0 at work."""
    out = 1 - smoothstep((s - arrive[0]) / (arrive[1] - arrive[0]))
    if leave is not None:
        out = max(out, smoothstep((s - leave[0]) / (leave[1] - leave[0])))
    return float(out)
