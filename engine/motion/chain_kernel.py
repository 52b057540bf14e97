"""Points followed through some frames, one step after the other, each point on one core: there, back, and compared with its query."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from degense.engine.motion.lucas_kanade import Octaves, follow, windows_of_a_thread
from degense.engine.motion.window_kernels import PAD, SAMPLES, bring_back, look_up_window, unlikeness
from degense.engine.threads import take_ticket

CHUNK = 8  # points that a thread takes at once


class FrameBlock(NamedTuple):
    """Frames one after the other among the planes of some, float32; all but the octaves as `padded`, those as `Pyramid` has them."""

    values: Octaves  # [S, h, w] each
    dx: Octaves
    dy: Octaves
    grey: np.ndarray  # [S, 1, H, W]
    colours: np.ndarray  # [S, 3, H, W]
    numbers: np.ndarray  # int64 [B]; of the planes, in the order of the frames


@njit(nogil=True, error_model="numpy")
def _there_and_back(values, dx, dy, before, number, x, y, astray, room):
    """Where the frame of a number shows what the one before it shows at a place; NaN if the way back does not end within `astray` of it."""
    x, y = x - 0.5, y - 0.5
    there_x, there_y = follow(values, dx, dy, values, (before, number), x, y, x, y, room)
    back_x, back_y = follow(values, dx, dy, values, (number, before), there_x, there_y, there_x, there_y, room)
    if not math.hypot(back_x - x, back_y - y) < astray:
        return np.nan, np.nan
    return there_x + 0.5, there_y + 0.5


@njit(nogil=True, cache=True, error_model="numpy")
def follow_through(values, slopes_x, slopes_y, grey, colours, numbers, points, kept, compared, search, limits, places, unlike, counter):
    """Follow points, rows int64 [n] of the windows that are kept, through the frames of a `FrameBlock`; `kept`, `compared` and `search` are
    those of `Windows`.

    `limits`, pixels: how far the way back may end from its beginning, and a direct match from where the step leads. A point is lost where
    it exceeds the first or leaves the frame, and goes by the direct match where that looks more like it. `places` float64 [n, B, 2] are
    given for the first frame, `unlike` float32 [n, B] is filled from the second on; both stay as they are where a point is lost.
    """
    room, seen, seen_colours = windows_of_a_thread(), np.empty((1, SAMPLES), np.float32), np.empty((3, SAMPLES), np.float32)
    grey_kept, dx, dy, inverse, colours_kept = kept
    (share, weights), (rounds, farthest), (astray, drifted) = compared, search, limits
    height, width = grey.shape[2] - 2 * PAD, grey.shape[3] - 2 * PAD
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= len(points):
            return
        for k in range(first, min(first + CHUNK, len(points))):
            row = points[k]
            x, y = places[k, 0, 0], places[k, 0, 1]
            for b in range(1, len(numbers)):
                number = numbers[b]
                x, y = _there_and_back(values, slopes_x, slopes_y, numbers[b - 1], number, x, y, astray, room)
                if not (0 <= x < width and 0 <= y < height):
                    break
                look_up_window(colours[number], x, y, seen_colours)
                least = unlikeness(seen_colours, colours_kept[row], share, weights)
                direct_x, direct_y = bring_back(grey[number], x, y, grey_kept[row], dx[row], dy[row], inverse[row], rounds, farthest, seen)
                if math.hypot(direct_x - x, direct_y - y) < drifted:
                    look_up_window(colours[number], direct_x, direct_y, seen_colours)
                    direct = unlikeness(seen_colours, colours_kept[row], share, weights)
                    if direct < least:
                        least, x, y = direct, direct_x, direct_y
                places[k, b, 0], places[k, b, 1], unlike[k, b] = x, y, least
