"""What a stroke covers: regions of pixels, found without a window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

Point = tuple[float, float]


class PixelRegion(NamedTuple):
    """Some pixels of a frame: the corner of a box, and which of its pixels count, bool [h, w], at least one."""

    top: int
    left: int
    mask: np.ndarray

    @property
    def box(self) -> tuple[slice, slice]:
        return slice(self.top, self.top + self.mask.shape[0]), slice(self.left, self.left + self.mask.shape[1])


def region_of(mask: np.ndarray, top: int = 0, left: int = 0) -> PixelRegion | None:
    """The true pixels of a mask bool [h, w] whose corner lies at (top, left), in the smallest box; None when there are none."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return None
    inner = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return PixelRegion(top + int(rows[0]), left + int(columns[0]), inner)


def brush(start: Point, end: Point, radius: float, shape: tuple[int, int]) -> PixelRegion | None:
    """Pixels whose centres lie within `radius` of the way from `start` to `end` (x, y; pixel centres at half integers).

    The pixels under the two ends always count, so that the finest brush paints too. None outside the picture.
    """
    height, width = shape
    (ax, ay), (bx, by) = start, end
    left, right = max(0, int(min(ax, bx) - radius) - 1), min(width, int(max(ax, bx) + radius) + 2)
    top, bottom = max(0, int(min(ay, by) - radius) - 1), min(height, int(max(ay, by) + radius) + 2)
    if left >= right or top >= bottom:
        return None
    x, y = np.arange(left, right) + 0.5 - ax, np.arange(top, bottom)[:, None] + 0.5 - ay
    dx, dy = bx - ax, by - ay
    length = dx * dx + dy * dy
    along = np.clip((x * dx + y * dy) / length, 0, 1) if length > 0 else 0.0
    mask = (x - along * dx) ** 2 + (y - along * dy) ** 2 <= radius * radius
    for px, py in (start, end):
        row, column = int(np.floor(py)) - top, int(np.floor(px)) - left
        if 0 <= row < mask.shape[0] and 0 <= column < mask.shape[1]:
            mask[row, column] = True
    return region_of(mask, top, left)


def polygon(points: Sequence[Point], shape: tuple[int, int]) -> PixelRegion | None:
    """The inside of a closed outline of three or more points (x, y), its edge included. ValueError for points that are no numbers."""
    if len(points) < 3:
        return None
    height, width = shape
    mask = np.zeros(shape, np.uint8)
    corners = np.clip(np.asarray(points, np.float64) - 0.5, -4 * max(shape), 5 * max(shape))
    if np.isnan(corners).any():
        raise ValueError("a corner that is no number")
    cv2.fillPoly(mask, [np.round(corners * 16).astype(np.int32)], 1, shift=4)
    return region_of(mask.astype(bool)[:height, :width])


def fill(labels: np.ndarray, at: tuple[int, int]) -> PixelRegion | None:
    """Pixels connected (by edges) to the pixel (x, y) through its own label; labels uint8 [H, W]."""
    x, y = at
    if not (0 <= y < labels.shape[0] and 0 <= x < labels.shape[1]):
        return None
    flooded = np.zeros((labels.shape[0] + 2, labels.shape[1] + 2), np.uint8)
    cv2.floodFill(labels.copy(), flooded, (x, y), 0, 0, 0, 4 | cv2.FLOODFILL_MASK_ONLY | (1 << 8))
    return region_of(flooded[1:-1, 1:-1].astype(bool))


def whole_regions(regions: np.ndarray, touched: PixelRegion | None) -> PixelRegion | None:
    """All pixels of the superpixels int32 [H, W] that a region touches."""
    if touched is None:
        return None
    chosen = np.unique(regions[touched.box][touched.mask])
    wanted = np.zeros(int(regions.max()) + 1, bool)
    wanted[chosen] = True
    return region_of(wanted[regions])


def holes(labels: np.ndarray, value: int) -> PixelRegion | None:
    """Pixels of other labels that a class encloses: what touches the picture's border is no hole."""
    others = np.pad(labels != value, 1, constant_values=True).astype(np.uint8)
    cv2.floodFill(others, None, (0, 0), 0)
    return region_of(others[1:-1, 1:-1] > 0)


def smaller_islands(labels: np.ndarray, value: int) -> PixelRegion | None:
    """The pixels of a class outside its largest connected part."""
    count, parts, stats, _ = cv2.connectedComponentsWithStats((labels == value).astype(np.uint8), connectivity=8)
    if count <= 2:
        return None
    smaller = np.ones(count, bool)
    smaller[0] = smaller[1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())] = False
    return region_of(smaller[parts])
