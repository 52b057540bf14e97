"""Colour masks: pictures in which a class is a colour."""

from __future__ import annotations

import numpy as np

from degense.engine.clip import UNLABELLED


def packed(rgb: np.ndarray) -> np.ndarray:
    """Colours as one number a pixel, int64 [...]."""
    return (rgb[..., 0].astype(np.int64) << 16) | (rgb[..., 1].astype(np.int64) << 8) | rgb[..., 2]


class ColourCodes:
    """A table of colours.

    Parameters
    ----------
    colours : sequence of (red, green, blue)
        Of the classes 0, 1, …; no two alike.
    """

    def __init__(self, colours: list[tuple[int, int, int]]):
        codes = packed(np.array(colours))
        self._order = np.argsort(codes)
        self._sorted = codes[self._order]

    def labels(self, mask: np.ndarray) -> np.ndarray:
        """Label map uint8 [H, W] of a colour mask uint8 [H, W, 3]; unknown colours → `UNLABELLED`."""
        codes = packed(mask)
        place = np.minimum(np.searchsorted(self._sorted, codes), len(self._order) - 1)
        return np.where(self._sorted[place] == codes, self._order[place], UNLABELLED).astype(np.uint8)
