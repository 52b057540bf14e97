"""Windows around points, looked up, brought back and compared: one pass a point, on all cores, a row of a window at once.

Images are planes float32 [C, H, W], continued by `PAD` pixels beyond each edge (`padded`). A window has `LANES` samples in each of its
rows, of which some may count for nothing.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit

from degense.engine.simd import LANES, fma, load, maximum, splat, store, sub, total
from degense.engine.threads import take_ticket

REACH, APART = 7, 2  # pixels: a window reaches so far to each side, and its rows are so far apart
ROWS = 2 * REACH // APART + 1
SAMPLES = ROWS * LANES
PAD = LANES  # pixels
CHUNK = 32  # points that a thread takes at once


def padded(image: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """Planes of an image uint8 or float32 [H, W] or [H, W, C], written to `out` or to new memory; beyond its edges it is as at them."""
    channels = cv2.split(image) if image.ndim == 3 else (image,)
    if out is None:
        out = np.empty((len(channels), *(side + 2 * PAD for side in image.shape[:2])), np.float32)
    for channel, plane in zip(channels, out, strict=True):
        plane[:] = cv2.copyMakeBorder(channel, PAD, PAD, PAD, PAD, cv2.BORDER_REPLICATE)
    return out


@njit(nogil=True, error_model="numpy")
def between(image, first, right):
    """`LANES` pixels in a row, from a flat index on, looked up so far to the right of them."""
    here = load(image, first)
    return fma(right, sub(load(image, first + 1), here), here)


@njit(nogil=True, error_model="numpy")
def look_up_window(planes, x, y, out):
    """What planes show around a pixel position; out float32 [C, SAMPLES]. All that is farther out is as at the edge."""
    channels, height, width = planes.shape
    x, y = min(max(x - 0.5, -1.0 - REACH), width - 2 * PAD + REACH - 1.0), min(max(y - 0.5, -1.0 - REACH), height - 2 * PAD + REACH - 1.0)
    column, row = math.floor(x), math.floor(y)
    right, below = splat(np.float32(x - column)), splat(np.float32(y - row))
    corner = (int(row) + PAD - REACH) * width + int(column) + PAD - REACH
    for c in range(channels):
        for i in range(ROWS):
            first = c * height * width + corner + i * APART * width
            upper, lower = between(planes, first, right), between(planes, first + width, right)
            store(out, c * SAMPLES + i * LANES, fma(below, sub(lower, upper), upper))


@njit(nogil=True, cache=True, error_model="numpy")
def look_up(planes, places, out, counter):
    """What planes show around pixel positions float64 [K, 2]; out float32 [K, C, SAMPLES]."""
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= places.shape[0]:
            return
        for k in range(first, min(first + CHUNK, places.shape[0])):
            look_up_window(planes, places[k, 0], places[k, 1], out[k])


@njit(nogil=True, error_model="numpy")
def unlikeness(seen, kept, share, weights):
    """Weighted mean absolute difference of two windows float32 [C, SAMPLES], where half of the mean difference of each channel is not
    counted; `share` and `weights` float32 [SAMPLES] of their samples sum up to 1."""
    channels = kept.shape[0]
    summed = splat(np.float32(0))
    for c in range(channels):
        common = splat(np.float32(0))
        for i in range(c * SAMPLES, (c + 1) * SAMPLES, LANES):
            common = fma(load(share, i - c * SAMPLES), sub(load(seen, i), load(kept, i)), common)
        half = splat(np.float32(total(common) / np.float32(2)))
        for i in range(c * SAMPLES, (c + 1) * SAMPLES, LANES):
            rest = sub(sub(load(seen, i), load(kept, i)), half)
            summed = fma(load(weights, i - c * SAMPLES), maximum(rest, sub(splat(np.float32(0)), rest)), summed)
    return total(summed) / np.float32(channels)


@njit(nogil=True, cache=True, error_model="numpy")
def compare(frames, numbers, places, rows, kept, share, weights, out, counter):
    """How unlike what is kept of points, float32 [P, C, SAMPLES], frames of `numbers` int64 [B] among planes [S, C, H, W] are at places
    float64 [K, B, 2] of some `rows` int64 [K] of them; out float32 [K, B], NaN where a place is."""
    seen = np.empty((kept.shape[1], SAMPLES), np.float32)
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= places.shape[0]:
            return
        for k in range(first, min(first + CHUNK, places.shape[0])):
            for b in range(len(numbers)):
                out[k, b] = np.nan
                if np.isfinite(places[k, b, 0]):
                    look_up_window(frames[numbers[b]], places[k, b, 0], places[k, b, 1], seen)
                    out[k, b] = unlikeness(seen, kept[rows[k]], share, weights)


@njit(nogil=True, error_model="numpy")
def _along(slopes, seen, kept):
    summed = splat(np.float32(0))
    for i in range(0, SAMPLES, LANES):
        summed = fma(load(slopes, i), sub(load(seen, i), load(kept, i)), summed)
    return total(summed)


@njit(nogil=True, error_model="numpy")
def bring_back(planes, x, y, kept, dx, dy, inverse, rounds, farthest, seen):
    """Where one plane shows a window float32 [SAMPLES], searched from a place on; its slopes `dx` and `dy`, `inverse` the elements xx, xy,
    yy of the inverse of their products; `seen` room for a window."""
    for _ in range(rounds):
        look_up_window(planes, x, y, seen)
        along_x, along_y = _along(dx, seen, kept), _along(dy, seen, kept)
        step_x, step_y = inverse[0] * along_x + inverse[1] * along_y, inverse[1] * along_x + inverse[2] * along_y
        x, y = x - min(max(step_x, -farthest), farthest), y - min(max(step_y, -farthest), farthest)
    return x, y


@njit(nogil=True, cache=True, error_model="numpy")
def descend(planes, places, rows, kept, dx, dy, inverse, rounds, farthest, counter):
    """Move places float64 [K, 2] of one plane, in place, to where it shows what is kept of points float32 [P, SAMPLES] (`bring_back`)."""
    seen = np.empty((1, SAMPLES), np.float32)
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= places.shape[0]:
            return
        for k in range(first, min(first + CHUNK, places.shape[0])):
            row = rows[k]
            places[k] = bring_back(planes, places[k, 0], places[k, 1], kept[row], dx[row], dy[row], inverse[row], rounds, farthest, seen)
