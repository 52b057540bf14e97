"""Cleaning of a binary mask: specks are removed, and holes closed that belong to no other class.

Components are found among runs of equal pixels in rows, which are few. The kernels hold no lock and use one core each, so that masks are
cleaned in as many threads as there are.
"""

from __future__ import annotations

import numpy as np
from numba import njit

import degense.engine.threads  # noqa: F401 - where compiled kernels are kept

#: Components smaller than this share of the picture (33 pixels at 640 × 512) are specks, unless nothing larger is there.
SPECK = 1e-4
#: Enclosed holes smaller than this share of the picture are closed whatever they show.
TINY_HOLE = 1e-4
#: Larger enclosed holes are closed up to this share, if similarity reaches half the threshold there and no other class fits better.
LARGEST_HOLE = 1e-2


def without_specks(mask: np.ndarray, least: float = 0.0) -> np.ndarray:
    """The mask, bool [H, W], without components (8-connected) below `SPECK`, of which the largest stays, nor any below the share `least`
    of the picture, down to none."""
    out = mask.copy()
    _drop_specks(out, SPECK, least)
    return out


def without_holes(mask: np.ndarray, similarity: np.ndarray, threshold: float, rivals: np.ndarray | None = None) -> np.ndarray:
    """The mask, bool [H, W], with enclosed holes (4-connected, not touching the picture's edge) closed.

    An instrument in front of an organ makes a true hole, a highlight on the organ a false one. A hole is closed when it is tiny,
    or when it is at most `LARGEST_HOLE`, the mean similarity in it reaches half the threshold,
    and the mean of the rivals (float [H, W], the best other class) does not exceed it.
    """
    out = mask.copy()
    _close_holes(out, similarity, similarity if rivals is None else rivals, 0.5 * threshold, TINY_HOLE, LARGEST_HOLE)
    return out


@njit(nogil=True, cache=True)
def _drop_specks(mask, speck, least):
    runs, areas = _components(mask, True, 1)
    largest = 0
    for k in range(len(areas)):
        if areas[k] > areas[largest]:
            largest = k
    for y, start, end, k in runs:
        if areas[k] < least * mask.size or (areas[k] < speck * mask.size and k != largest):
            mask[y, start:end] = False


@njit(nogil=True, cache=True)
def _close_holes(mask, similarity, rivals, fitting, tiny, largest):
    height, width = mask.shape
    runs, areas = _components(mask, False, 0)
    enclosed = areas <= largest * mask.size
    for y, start, end, k in runs:
        if y == 0 or y == height - 1 or start == 0 or end == width:
            enclosed[k] = False
    ours, theirs = np.zeros(len(areas)), np.zeros(len(areas))
    for y, start, end, k in runs:
        if enclosed[k] and areas[k] >= tiny * mask.size:
            for x in range(start, end):
                ours[k] += similarity[y, x]
                theirs[k] += rivals[y, x]
    for y, start, end, k in runs:
        if enclosed[k] and (areas[k] < tiny * mask.size or (ours[k] / areas[k] >= fitting and theirs[k] <= ours[k])):
            mask[y, start:end] = True


@njit(nogil=True, cache=True)
def _components(mask, value, slant):
    """Runs of a value, int64 [n, 4] of (row, start, end, component), and the area of each component; slant 1 connects corners too.

    A component has the number of its first run; areas [n] of other numbers are 0.
    """
    height, width = mask.shape
    count = 0
    for y in range(height):
        inside = False
        for x in range(width):
            here = mask[y, x] == value
            count += here and not inside
            inside = here
    runs = np.empty((count, 4), np.int64)
    k, above, first = 0, 0, 0  # above … first: the runs of the row before
    for y in range(height):
        x, seen = 0, above
        while x < width:
            if mask[y, x] != value:
                x += 1
                continue
            start = x
            while x < width and mask[y, x] == value:
                x += 1
            runs[k, 0], runs[k, 1], runs[k, 2], runs[k, 3] = y, start, x, k
            while seen < first and runs[seen, 2] + slant <= start:
                seen += 1
            other = seen
            while other < first and runs[other, 1] < x + slant:
                a, b = _root(runs, k), _root(runs, other)
                runs[max(a, b), 3] = min(a, b)
                other += 1
            k += 1
        above, first = first, k
    areas = np.zeros(count, np.int64)
    for k in range(count):
        runs[k, 3] = runs[runs[k, 3], 3]  # of an earlier run, which knows its first
        areas[runs[k, 3]] += runs[k, 2] - runs[k, 1]
    return runs, areas


@njit(inline="always")
def _root(runs, k):
    while runs[k, 3] != k:
        runs[k, 3] = runs[runs[k, 3], 3]
        k = runs[k, 3]
    return k
