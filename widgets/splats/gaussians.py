"""Gaussians as the 3D view holds them, and how some of them are highlighted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

#: Colour of marked splats, its share beside their own, and their least opacity.
HIGHLIGHT, MARKED = np.array([1.0, 0.25, 1.0], np.float32), 0.6
#: Below this opacity nothing is drawn.
FAINTEST = 1 / 255


class Gaussians(NamedTuple):
    """What can be drawn, all finite float32: means [N, 3], unit quats [N, 4] (wxyz), scales [N, 3], opacities [N], colours [N, 3].

    Colours may lie outside [0, 1]: only the pixel that several Gaussians blend to is clipped.
    """

    means: np.ndarray
    quats: np.ndarray
    scales: np.ndarray
    opacities: np.ndarray
    colours: np.ndarray


def tamed(means: np.ndarray, quats: np.ndarray, scales: np.ndarray, opacities: np.ndarray, colours: np.ndarray) -> Gaussians:
    """Gaussians with quaternions of any length made units (zero: no rotation), from colours uint8 or float (1 is full).

    One with a number that is not finite is made invisible and put where a finite one lies.
    """
    colours = colours.astype(np.float32) / 255 if colours.dtype == np.uint8 else np.asarray(colours, np.float32)
    means, quats, scales = (np.asarray(a, np.float32) for a in (means, quats, scales))
    opacities = np.asarray(opacities, np.float32).reshape(-1)
    if not all(np.isfinite(array.sum()) for array in (means, quats, scales, opacities, colours)):
        sound = np.isfinite(np.column_stack([means, quats, scales, opacities, colours])).all(1)
        place = means[np.argmax(sound)] if sound.any() else np.zeros(3, np.float32)
        means = np.where(sound[:, None], means, place)
        quats, scales, colours = (np.where(sound[:, None], a, np.float32(0.0)) for a in (quats, scales, colours))
        opacities = np.where(sound, opacities, np.float32(0.0))
    lengths = np.sqrt(np.einsum("ni,ni->n", quats, quats))[:, None]
    if not (lengths > 0.0).all():
        quats = np.where(lengths > 0.0, quats, np.array([1.0, 0.0, 0.0, 0.0], np.float32))
        lengths = np.where(lengths > 0.0, lengths, np.float32(1.0))
    return Gaussians(means, quats / lengths, scales, opacities, colours)


def visible(gaussians: Gaussians) -> np.ndarray:
    """Which are there at this time, bool [N]."""
    return gaussians.opacities >= FAINTEST


def highlighted(gaussians: Gaussians, indices: np.ndarray | None) -> Gaussians:
    """The same with some splats in magenta and opaque enough to be seen, but for those that are not there; None marks nothing."""
    if indices is None:
        return gaussians
    colours, opacities = gaussians.colours.copy(), gaussians.opacities.copy()
    colours[indices] = HIGHLIGHT * np.float32(MARKED) + colours[indices] * np.float32(1 - MARKED)
    opacities[indices] = np.where(opacities[indices] < FAINTEST, 0.0, np.maximum(opacities[indices], MARKED))
    return gaussians._replace(opacities=opacities, colours=colours)
