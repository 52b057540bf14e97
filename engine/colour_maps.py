"""Colour maps for numbers and colours for masks, as arrays: headless code uses them too."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np

#: Perceptually even and safe for colour-blind readers: three of matplotlib's, and vik (Crameri 2018, MIT; diverging).
COLOUR_MAPS = ("viridis", "cividis", "magma", "vik")
#: Equidistant colours of vik, interpolated linearly in between.
_VIK = bytes.fromhex("001261033e7d1e6f9d71a8c4c9dde7ebe5e0eacebdd39774be65338b2706590008")

#: Of classes and prompts. Okabe–Ito without black, then Tol's bright and muted colours: told apart by colour-blind readers and on dark
#: tissue; the most alike come last.
CLASS_COLOURS = (
    (230, 159, 0),
    (86, 180, 233),
    (0, 158, 115),
    (240, 228, 66),
    (0, 114, 178),
    (213, 94, 0),
    (204, 121, 167),
    (170, 51, 119),
    (153, 153, 51),
    (51, 34, 136),
    (204, 102, 119),
    (68, 170, 153),
    (221, 204, 119),
    (204, 187, 68),
    (102, 204, 238),
    (136, 204, 238),
)

#: What a number that is not known looks like.
UNKNOWN = (128, 128, 128)


@cache
def colour_table(name: str) -> np.ndarray:
    """The 256 colours of a map, uint8 [256, 3], read-only."""
    if name not in COLOUR_MAPS:
        raise ValueError(f"unknown colour map {name!r}; there are {', '.join(COLOUR_MAPS)}")
    if name == "vik":
        stops = np.frombuffer(_VIK, np.uint8).reshape(-1, 3)
        colours = np.stack([np.interp(np.linspace(0, 1, 256), np.linspace(0, 1, len(stops)), stops[:, c]) for c in range(3)], -1)
    else:
        colours = cv2.applyColorMap(np.arange(256, dtype=np.uint8)[:, None], getattr(cv2, f"COLORMAP_{name.upper()}"))[:, 0, ::-1]
    table = colours.round().astype(np.uint8)
    table.flags.writeable = False
    return table


def colourise(values: np.ndarray, name: str, low: float, high: float) -> np.ndarray:
    """Colours, uint8 [..., 3], of numbers [...]: `low` and below take the first colour, `high` and above the last, NaN a neutral grey."""
    values = np.asarray(values, np.float32)
    span = high - low
    with np.errstate(invalid="ignore", over="ignore"):
        position = (values - np.float32(low)) * np.float32(255.0 / span if span > 0 else 0.0)
    missing = np.isnan(values)
    index = np.where(missing, 0, np.clip(np.nan_to_num(position, nan=0.0, posinf=255.0, neginf=0.0), 0.0, 255.0) + 0.5).astype(np.uint8)
    colours = colour_table(name)[index]
    colours[missing] = UNKNOWN
    return colours


def hatched(colours: np.ndarray, where: np.ndarray) -> np.ndarray:
    """`colours` uint8 [H, W, 3] with diagonal stripes `where` (bool [H, W]): white on dark colours, black on light ones."""
    height, width = where.shape
    period = max(8, width // 48)
    stripes = where & ((np.arange(width) + np.arange(height)[:, None]) % period < period // 4)
    light = colours @ np.array([0.299, 0.587, 0.114]) > 127.5
    ink = np.where(light, 0, 255)[..., None]
    return np.where(stripes[..., None], (colours * 0.4 + ink * 0.6 + 0.5).astype(np.uint8), colours)


def greyed(colours: np.ndarray, where: np.ndarray) -> np.ndarray:
    """`colours` uint8 [N, 3], halfway to the grey of the unknown `where` (bool [N]): a Gaussian cannot be hatched."""
    return np.where(where[:, None], ((colours.astype(np.uint16) + UNKNOWN) // 2).astype(np.uint8), colours)


def mask_overlay(masks: Sequence[tuple[np.ndarray, tuple[int, int, int]]], fill: float = 0.45) -> np.ndarray:
    """Masks (bool [H, W]) painted in their colours, uint8 RGBA [H, W, 4]: translucent inside, opaque along the inner edge.

    Later masks lie on top.
    """
    if not masks:
        raise ValueError("no masks to paint")
    overlay = np.zeros((*masks[0][0].shape, 4), np.uint8)
    for mask, colour in masks:
        overlay[mask] = (*colour, round(255 * fill))
        inside = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(bool)
        overlay[mask & ~inside] = (*colour, 255)
    return overlay
