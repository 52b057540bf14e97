"""Blending forward: every tile walks its Gaussians from the nearest, eight pixels of a row at a time.

A Gaussian visits exactly the blocks of eight pixels that its ellipse of alpha ≥ MIN_ALPHA touches. A tile's pixels lie in planes (transmittance, then one
plane a channel) that fit the cache; a finished pixel's transmittance is kept with its sign turned, so that it passes no test again.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from engine.raster.limits import MAX_ALPHA, MIN_TRANSMITTANCE
from engine.raster.project import ACROSS, ALONG, HEADROOM, LEVEL, LOG2_MIN_ALPHA, REACH, SHEAR, TILE_HEIGHT, TILE_WIDTH, X, Y
from engine.raster.simd import (
    LANES,
    both,
    exp2,
    finished,
    fma,
    greater,
    load,
    minimum,
    mul,
    ramp,
    select,
    some,
    splat,
    store,
    sub,
    take_ticket,
)

AREA = TILE_WIDTH * TILE_HEIGHT
CHECK_EVERY = 16  # Gaussians between two looks at which rows of a tile are finished

_MIN_LEVEL = np.float32(LOG2_MIN_ALPHA)
_MAX_ALPHA = np.float32(MAX_ALPHA)
_MIN_TRANSMITTANCE = np.float32(MIN_TRANSMITTANCE)


@njit(nogil=True, error_model="numpy")
def rows_of(splats, g, top, bottom):
    """Rows of pixels [first, last) of a tile's [top, bottom) that a Gaussian may touch."""
    middle, reach = splats[g, Y] - np.float32(0.5), splats[g, REACH] + np.float32(1e-3)
    first = top + max(0, int(math.ceil(min(np.float32(bottom), middle - reach) - top)))
    last = top + min(bottom - top, int(math.floor(max(np.float32(top) - np.float32(1.0), middle + reach) - top)) + 1)
    return first, last


@njit(nogil=True, error_model="numpy")
def blocks_of(splats, g, row, left, width):
    """Blocks [first, last) of LANES pixels that a Gaussian touches in a row, its centre there, and the exponent it has in that centre (both float32)."""
    dy = np.float32(row) + np.float32(0.5) - splats[g, Y]
    drop = splats[g, ALONG] * dy * dy
    center = splats[g, X] - np.float32(left) - np.float32(0.5) + splats[g, SHEAR] * dy
    half = math.sqrt(max(np.float32(0.0), splats[g, HEADROOM] - drop) / splats[g, ACROSS]) + np.float32(1e-3)
    first = int(math.ceil(min(np.float32(width), max(np.float32(0.0), center - half))))
    last = int(math.floor(max(np.float32(-1.0), min(np.float32(width - 1), center + half))))
    return first // LANES, (last + LANES) // LANES, center, splats[g, LEVEL] - drop, dy


@njit(nogil=True, error_model="numpy")
def clear_transmittance(planes, at, width):
    """Start a tile's plane: 1 where there is a pixel, finished where there is none."""
    for row in range(TILE_HEIGHT):
        for column in range(TILE_WIDTH):
            planes[at + row * TILE_WIDTH + column] = np.float32(1.0) if column < width else np.float32(-1.0)


@njit(nogil=True, error_model="numpy")
def find_live_rows(planes, at, rows, live):
    """Note which rows still have an unfinished pixel; True if any."""
    found = False
    zero = splat(np.float32(0.0))
    for row in range(rows):
        if live[row]:
            alive = False
            for column in range(0, TILE_WIDTH, LANES):
                alive |= some(greater(load(planes, at + row * TILE_WIDTH + column), zero))
            live[row] = alive
            found |= alive
    return found


@njit(nogil=True, error_model="numpy")
def _blend_tile(members, start, stop, splats, features, left, top, width, rows, planes, at, live):
    """Blend one tile into `planes` (from index `at`): transmittance first, then the channels."""
    channels = features.shape[1]
    clear_transmittance(planes, at, width)
    planes[at + AREA : at + (1 + channels) * AREA] = 0.0
    live[:rows] = True
    zero, floor, ceiling, dark = splat(np.float32(0.0)), splat(_MIN_LEVEL), splat(_MAX_ALPHA), splat(_MIN_TRANSMITTANCE)
    flat_features = features.reshape(features.size)
    for i in range(start, stop):
        if (i - start) % CHECK_EVERY == CHECK_EVERY - 1 and not find_live_rows(planes, at, rows, live):
            return
        g = np.int64(members[i])
        feature = g * channels
        minus_across = splat(-splats[g, ACROSS])
        first_row, last_row = rows_of(splats, g, top, top + rows)
        for row in range(first_row, last_row):
            if not live[row - top]:
                continue
            first, last, center, peak, _ = blocks_of(splats, g, row, left, width)
            level = splat(peak)
            for block in range(first, last):
                pixel = at + (row - top) * TILE_WIDTH + block * LANES
                dx = ramp(np.float32(block * LANES) - center)
                exponent = fma(mul(minus_across, dx), dx, level)
                alpha = minimum(exp2(exponent), ceiling)
                before = load(planes, pixel)
                weight = mul(alpha, before)
                after = sub(before, weight)
                seen = greater(exponent, floor)
                drawn = both(seen, greater(after, dark))
                weight = select(drawn, weight, zero)
                store(planes, pixel, select(drawn, after, select(seen, finished(before), before)))
                for channel in range(channels):
                    pixel += AREA
                    store(planes, pixel, fma(splat(flat_features[feature + channel]), weight, load(planes, pixel)))


@njit(nogil=True, parallel=True, cache=True, error_model="numpy")
def blend(starts, members, splats, features, background, image, transmittance, planes, lives, counter):
    """Fill `image` [H, W, C] and `transmittance` [H, W] (what light is left).

    `planes` [threads, (1 + C) AREA] and `lives` [threads, TILE_HEIGHT] are work space, `counter` [1] is zero.
    """
    height, width, channels = image.shape
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    flat = planes.reshape(planes.size)
    for thread in prange(planes.shape[0]):
        at = thread * planes.shape[1]
        while True:
            tile = take_ticket(counter)
            if tile >= starts.shape[0] - 1:
                break
            left, top = (tile % columns) * TILE_WIDTH, (tile // columns) * TILE_HEIGHT
            tile_width, rows = min(TILE_WIDTH, width - left), min(TILE_HEIGHT, height - top)
            _blend_tile(members, starts[tile], starts[tile + 1], splats, features, left, top, tile_width, rows, flat, at, lives[thread])
            for row in range(rows):
                for column in range(tile_width):
                    pixel = at + row * TILE_WIDTH + column
                    light = abs(flat[pixel])
                    transmittance[top + row, left + column] = light
                    for channel in range(channels):
                        pixel += AREA
                        image[top + row, left + column, channel] = flat[pixel] + light * background[channel]
