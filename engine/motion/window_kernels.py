"""Windows around points, looked up, brought back and compared: one pass a point, on all cores.

A window's samples lie whole pixels apart, so that all of them share one set of bilinear weights. Beyond the image it is as at its edge.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from degense.engine.threads import take_ticket

CHUNK = 32  # points that a thread takes at once
FAR = 1e6  # pixels: no image reaches so far


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _look_up(image, x, y, offsets, out):
    """What an image [H, W, C] shows around a pixel position, at its square of `offsets` int64 [n], row after row; out float32 [n², C]."""
    height, width, channels = image.shape
    x, y = min(max(x - 0.5, -FAR), FAR), min(max(y - 0.5, -FAR), FAR)
    column, row = math.floor(x), math.floor(y)
    right, below = np.float32(x - column), np.float32(y - row)
    left, above = np.float32(1) - right, np.float32(1) - below
    inside = column + offsets[0] >= 0 and row + offsets[0] >= 0 and column + offsets[-1] + 1 < width and row + offsets[-1] + 1 < height
    sample = 0
    for down in offsets:
        top, bottom = row + down, row + down + 1
        if not inside:
            top, bottom = min(max(top, 0), height - 1), min(max(bottom, 0), height - 1)
        for across in offsets:
            first, second = column + across, column + across + 1
            if not inside:
                first, second = min(max(first, 0), width - 1), min(max(second, 0), width - 1)
            for c in range(channels):
                upper = left * np.float32(image[top, first, c]) + right * np.float32(image[top, second, c])
                lower = left * np.float32(image[bottom, first, c]) + right * np.float32(image[bottom, second, c])
                out[sample, c] = above * upper + below * lower
            sample += 1


@njit(nogil=True, cache=True, error_model="numpy")
def look_up(image, places, offsets, out, counter):
    """What an image uint8 or float32 [H, W, C] shows around pixel positions float64 [K, 2]; out float32 [K, n², C]."""
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= places.shape[0]:
            return
        for k in range(first, min(first + CHUNK, places.shape[0])):
            _look_up(image, places[k, 0], places[k, 1], offsets, out[k])


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _unlikeness(seen, kept, weights):
    """Weighted mean absolute difference of two windows [n, C], where half of the mean difference of each channel is not counted."""
    samples, channels = kept.shape
    total = np.float32(0)
    for c in range(channels):
        common = np.float32(0)
        for sample in range(samples):
            common += seen[sample, c] - kept[sample, c]
        common /= np.float32(2 * samples)
        for sample in range(samples):
            total += weights[sample] * abs(seen[sample, c] - kept[sample, c] - common)
    return total / np.float32(channels)


@njit(nogil=True, cache=True, error_model="numpy")
def compare(image, places, offsets, rows, kept, weights, out, counter):
    """How unlike what is kept of points, float32 [P, n², C], an image uint8 [H, W, C] is at places float64 [K, 2] of some `rows` int64 [K]
    of them; out float32 [K]."""
    seen = np.empty(kept.shape[1:], np.float32)
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= places.shape[0]:
            return
        for k in range(first, min(first + CHUNK, places.shape[0])):
            _look_up(image, places[k, 0], places[k, 1], offsets, seen)
            out[k] = _unlikeness(seen, kept[rows[k]], weights)


@njit(nogil=True, cache=True, error_model="numpy", fastmath=True)
def _along(slopes, seen, kept):
    total = np.float32(0)
    for sample in range(kept.shape[0]):
        total += slopes[sample] * (seen[sample, 0] - kept[sample])
    return total


@njit(nogil=True, cache=True, error_model="numpy")
def descend(image, places, offsets, rows, kept, dx, dy, inverse, rounds, farthest, counter):
    """Move places float64 [K, 2] of an image float32 [H, W, 1], in place, to where it shows what is kept of points float32 [P, n²].

    `dx`, `dy` are the slopes of windows float32 [P, n²], `inverse` the elements xx, xy, yy of the inverse of their products [P, 3].
    """
    seen = np.empty((kept.shape[1], 1), np.float32)
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= places.shape[0]:
            return
        for k in range(first, min(first + CHUNK, places.shape[0])):
            row = rows[k]
            for _ in range(rounds):
                _look_up(image, places[k, 0], places[k, 1], offsets, seen)
                along_x, along_y = _along(dx[row], seen, kept[row]), _along(dy[row], seen, kept[row])
                step_x = inverse[row, 0] * along_x + inverse[row, 1] * along_y
                step_y = inverse[row, 1] * along_x + inverse[row, 2] * along_y
                places[k, 0] -= min(max(step_x, -farthest), farthest)
                places[k, 1] -= min(max(step_y, -farthest), farthest)
