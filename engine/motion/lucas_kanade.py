"""Points followed from one frame to another by Lucas-Kanade in a pyramid (Bouguet, 2001), all that a frame needs for it made once.

As `cv2.calcOpticalFlowPyrLK`, which makes pyramids and slopes anew in each call, and looks windows up several times as slowly.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit

from degense.engine.motion.window_kernels import between
from degense.engine.simd import LANES, fma, greater, load, mul, ramp, select, splat, store, sub, total
from degense.engine.threads import run_kernel, take_ticket

SIDE, LEVELS = 15, 4  # of the windows that are followed: pixels, and octaves
ROUNDS, STILL = 10, 0.03  # in each octave, until a round moves a window by fewer pixels
TO_AND_FRO = 0.01  # pixels: two rounds that undo each other so nearly end the search half-way between
TEXTURE = 0.1  # squared grey levels a pixel²: a window with weaker slopes along some direction is not moved
CHUNK = 16  # points that a thread takes at once
_PAD = LANES  # pixels that frames are continued by beyond their edges

Octaves = tuple[np.ndarray, ...]
Slopes = tuple[Octaves, Octaves, Octaves]  # values, and how they change along x and y


class Pyramid:
    """A frame uint8 [H, W] in octaves, each half as large as the one before: values and slopes float32 [1, h, w], padded.

    `room`, what another frame of this size has, is overwritten; new memory is taken without.
    """

    def __init__(self, grey: np.ndarray, room: Slopes | None = None):
        octaves = [grey]
        while len(octaves) < LEVELS and (min(octaves[-1].shape) + 1) // 2 > SIDE:
            octaves.append(cv2.pyrDown(octaves[-1]))
        self.values, self.dx, self.dy = room or (_room(octaves), _room(octaves), _room(octaves))
        for octave, values, dx, dy in zip(octaves, self.values, self.dx, self.dy, strict=True):
            values[0] = cv2.copyMakeBorder(octave, _PAD, _PAD, _PAD, _PAD, cv2.BORDER_REFLECT_101)
            for slopes, order in ((dx, (1, 0)), (dy, (0, 1))):
                cv2.Scharr(octave, cv2.CV_32F, *order, dst=slopes[0, _PAD:-_PAD, _PAD:-_PAD], scale=1 / 32)

    def to(self, other: Pyramid, places: np.ndarray, guesses: np.ndarray | None = None) -> np.ndarray:
        """Where what is seen at pixel positions [n, 2] is in another frame of the same size, float64 [n, 2].

        The search begins at `guesses` [n, 2]; without them at the places themselves.
        """
        start = np.asarray(places, np.float64) - 0.5
        found = start.copy() if guesses is None else np.asarray(guesses, np.float64) - 0.5
        run_kernel(_follow_all, self.values, self.dx, self.dy, other.values, start, found)
        return found + 0.5


def _room(octaves: list[np.ndarray]) -> Octaves:
    return tuple(np.zeros((1, *(side + 2 * _PAD for side in octave.shape)), np.float32) for octave in octaves)


@njit(nogil=True, error_model="numpy")
def _corner(image, x, y):
    """Where the window around a place of a padded image begins: flat index of a pixel, -1 outside of the padding, and rest of x and y."""
    left, top = x + (_PAD - SIDE // 2), y + (_PAD - SIDE // 2)
    if not (left >= 0 and top >= 0 and left <= image.shape[1] - LANES - 2 and top <= image.shape[0] - SIDE - 2):
        return -1, splat(np.float32(0)), splat(np.float32(0))
    column, row = int(left), int(top)
    return row * image.shape[1] + column, splat(np.float32(left - column)), splat(np.float32(top - row))


@njit(nogil=True, error_model="numpy")
def _look_up(image, x, y, valid, out):
    """Write the window around a place, float32 [SIDE * LANES]; what is not `valid` of a row counts as 0. Whether it is in the padding."""
    first, right, below = _corner(image, x, y)
    if first < 0:
        return False
    upper = between(image, first, right)
    for i in range(SIDE):
        first += image.shape[1]
        lower = between(image, first, right)
        store(out, i * LANES, mul(valid, fma(below, sub(lower, upper), upper)))
        upper = lower
    return True


@njit(nogil=True, error_model="numpy")
def _product(a, b):
    """Sum over windows of the product of two."""
    summed = splat(np.float32(0))
    for i in range(SIDE):
        summed = fma(load(a, i * LANES), load(b, i * LANES), summed)
    return total(summed)


@njit(nogil=True, error_model="numpy")
def _residual(image, x, y, window):
    """Products of the slopes of a window with what a padded image differs by from it at a place; whether that lies in the padding."""
    kept, dx, dy = window
    first, right, below = _corner(image, x, y)
    if first < 0:
        return 0.0, 0.0, False
    along_x, along_y = splat(np.float32(0)), splat(np.float32(0))
    upper = between(image, first, right)
    for i in range(SIDE):
        first += image.shape[1]
        lower = between(image, first, right)
        rest = sub(fma(below, sub(lower, upper), upper), load(kept, i * LANES))
        along_x, along_y = fma(rest, load(dx, i * LANES), along_x), fma(rest, load(dy, i * LANES), along_y)
        upper = lower
    return total(along_x), total(along_y), True


@njit(nogil=True, error_model="numpy")
def _descend(image, x, y, window):
    """Where a padded image shows a window, from a place on; `window`: what it shows and its slopes, float32 [SIDE * LANES] each."""
    _, dx, dy = window
    xx, xy, yy = np.float64(_product(dx, dx)), np.float64(_product(dx, dy)), np.float64(_product(dy, dy))
    weakest = (xx + yy - math.sqrt((xx - yy) ** 2 + 4 * xy * xy)) / 2
    if weakest < TEXTURE * SIDE * SIDE:
        return x, y
    inverse = 1 / (xx * yy - xy * xy)
    before_x, before_y = 0.0, 0.0
    for number in range(ROUNDS):
        along_x, along_y, inside = _residual(image, x, y, window)
        if not inside:
            break
        step_x, step_y = (xy * along_y - yy * along_x) * inverse, (xy * along_x - xx * along_y) * inverse
        x, y = x + step_x, y + step_y
        if step_x * step_x + step_y * step_y <= STILL * STILL:
            break
        if number > 0 and abs(step_x + before_x) < TO_AND_FRO and abs(step_y + before_y) < TO_AND_FRO:
            x, y = x - step_x / 2, y - step_y / 2
            break
        before_x, before_y = step_x, step_y
    return x, y


@njit(nogil=True, error_model="numpy")
def windows_of_a_thread():
    """Room for a window and its slopes along x and y, float32 [SIDE * LANES] each, and which lanes of a row belong to them."""
    valid = select(greater(splat(np.float32(SIDE - 0.5)), ramp(np.float32(0))), splat(np.float32(1)), splat(np.float32(0)))
    return np.empty(SIDE * LANES, np.float32), np.empty(SIDE * LANES, np.float32), np.empty(SIDE * LANES, np.float32), valid


@njit(nogil=True, error_model="numpy")
def follow(values, slopes_x, slopes_y, others, numbers, start_x, start_y, x, y, room):
    """Where the second of two frames shows what the first shows at a start, searched from x and y on.

    Octaves of frames float32 [B, h, w], places of pixels' centres at whole numbers; `numbers`: of the first among `values`, of the second
    among `others`; `room`: `windows_of_a_thread`.
    """
    kept, dx, dy, valid = room
    here, there = numbers
    coarsest = len(values) - 1
    x, y = x / (1 << coarsest), y / (1 << coarsest)
    for level in range(coarsest, -1, -1):
        here_x, here_y = start_x / (1 << level), start_y / (1 << level)
        if _look_up(values[level][here], here_x, here_y, valid, kept):
            _look_up(slopes_x[level][here], here_x, here_y, valid, dx)
            _look_up(slopes_y[level][here], here_x, here_y, valid, dy)
            x, y = _descend(others[level][there], x, y, (kept, dx, dy))
        if level > 0:
            x, y = 2 * x, 2 * y
    return x, y


@njit(nogil=True, cache=True, error_model="numpy")
def _follow_all(values, slopes_x, slopes_y, others, start, found, counter):
    """Move places float64 [n, 2] in `found`, of pixels' centres at whole numbers, to where the other frame shows what `start` shows."""
    room = windows_of_a_thread()
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= start.shape[0]:
            return
        for k in range(first, min(first + CHUNK, start.shape[0])):
            found[k] = follow(values, slopes_x, slopes_y, others, (0, 0), start[k, 0], start[k, 1], found[k, 0], found[k, 1], room)
