"""Superpixels: small regions of like colour that keep to the edges of a picture (SLIC).

Every pixel looks at the nine nearest centres only, so all pixels work in parallel, and all rounds but the last look at every other pixel
of every other row: they only have to move the centres.

Measured on a hand-drawn label map of a cholecystectomy frame (854×480, regions of 12 pixels, two cores): achievable accuracy 0.983 in
8 ms, against 0.979 in 136 ms for OpenCV's SLICO and 0.983 in 112 ms for its SLIC.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

from degense.engine.threads import run_kernel, take_ticket

#: Side of a superpixel, pixels.
REGION_SIZE = 12
#: How much shape counts against colour: the colour distance (CIELAB units) that weighs as much as one region side.
COMPACTNESS = 10.0
#: Rounds of assigning pixels and moving centres; more changes little.
ROUNDS = 5
LINES = 16  # that a thread takes at once
#: sRGB byte → linear light.
LINEAR = np.where(np.arange(256) <= 10, np.arange(256) / 255 / 12.92, ((np.arange(256) / 255 + 0.055) / 1.055) ** 2.4).astype(np.float32)


def superpixels(rgb: np.ndarray, region_size: int = REGION_SIZE, compactness: float = COMPACTNESS) -> np.ndarray:
    """Regions of an RGB image uint8 [H, W, 3]: int32 [H, W], values 0 … K − 1; every value occurs.

    Simple linear iterative clustering in (L, a, b, x, y) with D² = ‖Δlab‖² + (compactness / region_size)² ‖Δxy‖².
    Regions are not forced to be connected: means over them do not need it. `region_size`, the pixels between centres, is at least 1, else
    ValueError.
    """
    if region_size < 1:
        raise ValueError(f"region_size must be at least 1, not {region_size}")
    height, width = rgb.shape[:2]
    smooth = cv2.GaussianBlur(np.ascontiguousarray(rgb), (3, 3), 0)
    rows, columns = centre_grid(width, height, region_size)
    lab = np.empty((3, height, width), np.float32)
    run_kernel(_lab, smooth.reshape(height, width, 3), LINEAR, lab)
    centres, labels = _initial_centres(lab, rows, columns), np.zeros((height, width), np.int32)
    pull = np.float32((compactness / region_size) ** 2)
    for round_ in range(ROUNDS):
        step = 1 if round_ == ROUNDS - 1 else 2
        run_kernel(_assign, lab, centres, rows, columns, pull, step, labels)
        if step > 1:
            _move(lab, labels, step, centres)
    return dense(labels, rows * columns)


def centre_grid(width: int, height: int, region_size: int = REGION_SIZE) -> tuple[int, int]:
    """Rows and columns of centres: a picture has at most as many superpixels as there are."""
    return max(1, round(height / region_size)), max(1, round(width / region_size))


def _initial_centres(lab: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """Centres on a grid, float32 [rows · columns, 5] of (L, a, b, x, y)."""
    _, height, width = lab.shape
    y = ((np.arange(rows) + 0.5) * height / rows).astype(int)
    x = ((np.arange(columns) + 0.5) * width / columns).astype(int)
    y, x = (grid.ravel() for grid in np.meshgrid(y, x, indexing="ij"))
    return np.concatenate([lab[:, y, x].T, np.stack([x, y], -1)], -1).astype(np.float32)


@njit(nogil=True, cache=True, error_model="numpy")
def _lab(rgb, linear, out, counter):
    """CIELAB (D65), float32 [3, H, W]. OpenCV's is interpolated from a table and up to 0.4 off, which the twin on a GPU would not share."""
    height, width = rgb.shape[:2]
    xyz = np.empty((3, width), np.float32)
    while True:
        first = take_ticket(counter) * LINES
        if first >= height:
            return
        for i in range(first, min(first + LINES, height)):
            for j in range(width):
                r, g, b = linear[rgb[i, j, 0]], linear[rgb[i, j, 1]], linear[rgb[i, j, 2]]
                xyz[0, j] = np.float32(0.412453 / 0.950456) * r + np.float32(0.357580 / 0.950456) * g + np.float32(0.180423 / 0.950456) * b
                xyz[1, j] = np.float32(0.212671) * r + np.float32(0.715160) * g + np.float32(0.072169) * b
                xyz[2, j] = np.float32(0.019334 / 1.088754) * r + np.float32(0.119193 / 1.088754) * g + np.float32(0.950227 / 1.088754) * b
            for plane in range(3):
                row = xyz[plane]
                for j in range(width):
                    row[j] = _root(row[j])
            light, a, b = out[0, i], out[1, i], out[2, i]
            for j in range(width):
                light[j] = np.float32(116.0) * xyz[1, j] - np.float32(16.0)
                a[j] = np.float32(500.0) * (xyz[0, j] - xyz[1, j])
                b[j] = np.float32(200.0) * (xyz[1, j] - xyz[2, j])


@njit(inline="always")
def _root(t):
    """The cube root, exact but for rounding: Halley's steps from a parabola close to it above the bound. A library's has no vector form."""
    y = np.float32(0.245) + t * (np.float32(1.47) - np.float32(0.72) * t)
    for _ in range(3):
        cube = y * y * y
        y *= (cube + np.float32(2.0) * t) / (np.float32(2.0) * cube + t)
    return y if t > np.float32(0.008856) else np.float32(7.787) * t + np.float32(16.0 / 116.0)


@njit(nogil=True, fastmath=True, cache=True)
def _assign(lab, centres, rows, columns, pull, step, labels, counter):
    """The nearest centre of every `step`th pixel of every `step`th line, of the nine around; beyond the border they are the same again."""
    _, height, width = lab.shape
    count = (width + step - 1) // step
    pixels, around = np.empty((4, count), np.float32), np.empty((9, 5, count), np.float32)  # (L, a, b, x); what its nine centres are
    names, nearest = np.empty((9, count), np.int32), np.empty(count, np.int32)
    distance, least = np.empty(count, np.float32), np.empty(count, np.float32)
    for i in range(count):
        pixels[3, i] = i * step
    while True:
        row = take_ticket(counter)
        if row >= rows:
            return
        for column in range(columns):
            first, last = (_begin(column, columns, width) + step - 1) // step, (_begin(column + 1, columns, width) + step - 1) // step
            for near in range(9):
                r, c = min(max(row + near // 3 - 1, 0), rows - 1), min(max(column + near % 3 - 1, 0), columns - 1)
                k = r * columns + c
                light, a, b = centres[k, 0], centres[k, 1], centres[k, 2]
                for i in range(first, last):
                    names[near, i] = k
                    around[near, 0, i], around[near, 1, i], around[near, 2, i] = light, a, b
                    around[near, 3, i], around[near, 4, i] = centres[k, 3], centres[k, 4]
        for y in range((_begin(row, rows, height) + step - 1) // step * step, _begin(row + 1, rows, height), step):
            for channel in range(3):
                for i in range(count):
                    pixels[channel, i] = lab[channel, y, i * step]
            least[:] = np.float32(np.inf)
            for near in range(9):
                _measure(pixels, np.float32(y), around[near], pull, distance)
                name = np.int32(near)
                for i in range(count):
                    nearest[i] = name if distance[i] < least[i] else nearest[i]
                for i in range(count):
                    least[i] = min(least[i], distance[i])
            for i in range(count):
                labels[y, i * step] = names[nearest[i], i]


@njit(inline="always")
def _begin(cell, cells, size):
    """The first of `size` pixels in a cell of the grid of centres."""
    return (cell * size + cells - 1) // cells


@njit(inline="always")
def _measure(pixels, y, centres, pull, out):
    """D² of pixels (L, a, b, x) [4, n] of a line to centres [5, n]; in two loops, each of few enough arrays for vector instructions."""
    for i in range(len(out)):
        light, a = pixels[0, i] - centres[0, i], pixels[1, i] - centres[1, i]
        out[i] = light * light + a * a
    for i in range(len(out)):
        b, right, down = pixels[2, i] - centres[2, i], pixels[3, i] - centres[3, i], y - centres[4, i]
        out[i] += b * b + pull * (right * right + down * down)


@njit(nogil=True, cache=True)
def _move(lab, labels, step, centres):
    sums = np.zeros((centres.shape[0], 6))
    for y in range(0, labels.shape[0], step):
        for x in range(0, labels.shape[1], step):
            k = labels[y, x]
            for channel in range(3):
                sums[k, channel] += lab[channel, y, x]
            sums[k, 3] += x
            sums[k, 4] += y
            sums[k, 5] += 1.0
    for k in range(centres.shape[0]):
        if sums[k, 5] > 0.0:
            for channel in range(5):
                centres[k, channel] = sums[k, channel] / sums[k, 5]


def dense(labels: np.ndarray, count: int) -> np.ndarray:
    """The same regions without unused numbers."""
    used = np.bincount(labels.ravel(), minlength=count) > 0
    return (np.cumsum(used, dtype=np.int32) - 1)[labels]
