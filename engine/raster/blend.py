"""Blending forward: every tile walks its Gaussians from the nearest, eight pixels of a row at a time.

A tile is 16 rows of 4 blocks of 8 pixels, so that a set of its blocks is one 64-bit number. A Gaussian visits exactly the
blocks that its ellipse of alpha ≥ MIN_ALPHA touches and that are not finished yet. A block's numbers lie side by side in the
cache: eight transmittances, then eight values of each channel. A finished pixel's transmittance is kept with its sign turned,
so that it passes no test again.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from engine.raster.limits import MAX_ALPHA, MIN_TRANSMITTANCE
from engine.raster.project import ACROSS, ALONG, HEADROOM, LOG2_MIN_ALPHA, SHEAR, TILE_HEIGHT, TILE_WIDTH, WIDTH, X, Y
from engine.raster.simd import (
    LANES,
    add,
    blocks_between,
    exp2,
    finished,
    fma,
    greater,
    load,
    lowest_bit,
    maximum,
    minimum,
    mul,
    ramp,
    select,
    some,
    splat,
    spread,
    sqrt,
    store,
    sub,
    take_ticket,
)

AREA = TILE_WIDTH * TILE_HEIGHT
BLOCKS_A_ROW = TILE_WIDTH // LANES
CHECK_EVERY = 16  # Gaussians between two looks at which blocks of a tile are finished

# A Gaussian's rows in a tile, float32 [3 TILE_HEIGHT]: dy, the x of the ridge (from the tile's first pixel), log2 of alpha there.
HEIGHT, CENTER, PEAK = 0, TILE_HEIGHT, 2 * TILE_HEIGHT
ROW_NUMBERS = 3 * TILE_HEIGHT

MIN_LEVEL = np.float32(LOG2_MIN_ALPHA)
MAX_ALPHA32 = np.float32(MAX_ALPHA)
MIN_TRANSMITTANCE32 = np.float32(MIN_TRANSMITTANCE)
_HALF, _ZERO, _ONE = np.float32(0.5), np.float32(0.0), np.float32(1.0)
_SLACK = np.float32(1e-3)  # pixels; the exact test is made at each pixel


@njit(nogil=True, error_model="numpy")
def touched_blocks(splats, g, left, top, width, rows):
    """The blocks of a tile that a Gaussian touches (uint64, bit BLOCKS_A_ROW row + block), and `rows` filled."""
    along, headroom = splat(-splats[g, ALONG]), splat(splats[g, HEADROOM])
    shear, ratio = splat(splats[g, SHEAR]), splat(splats[g, WIDTH])
    middle = splat(splats[g, X] - np.float32(left) - _HALF)
    right, end, none = splat(np.float32(width - 1)), splat(np.float32(width)), splat(-_ONE)
    zero, slack, faint = splat(_ZERO), splat(_SLACK), splat(MIN_LEVEL)
    bits = np.uint64(0)
    for row in range(0, TILE_HEIGHT, LANES):
        dy = ramp(np.float32(top + row) + _HALF - splats[g, Y])
        room = fma(mul(along, dy), dy, headroom)
        center = fma(shear, dy, middle)
        store(rows, HEIGHT + row, dy)
        store(rows, CENTER + row, center)
        store(rows, PEAK + row, add(room, faint))
        half = add(sqrt(mul(maximum(room, zero), ratio)), slack)
        low = minimum(maximum(sub(center, half), zero), end)
        high = maximum(minimum(add(center, half), right), none)
        high = select(greater(room, zero), high, none)
        bits |= blocks_between(low, high) << np.uint64(BLOCKS_A_ROW * row)
    return bits


@njit(nogil=True, error_model="numpy")
def start_tile(values, stride, width, rows):
    """Set a tile's numbers to zero but the transmittances: 1 where there is a pixel, finished where there is none."""
    values[:] = _ZERO
    for row in range(TILE_HEIGHT):
        for column in range(TILE_WIDTH):
            values[index_of(row, column, stride)] = _ONE if row < rows and column < width else -_ONE


@njit(nogil=True, error_model="numpy")
def index_of(row, column, stride):
    """Where a pixel's transmittance lies in a tile whose blocks have `stride` numbers; its other numbers follow at steps of LANES."""
    return (row * BLOCKS_A_ROW + column // LANES) * stride + column % LANES


@njit(nogil=True, error_model="numpy")
def live_blocks(values, stride):
    """Blocks with an unfinished pixel, uint64."""
    zero, bits = splat(_ZERO), np.uint64(0)
    for block in range(AREA // LANES):
        if some(greater(load(values, block * stride), zero)):
            bits |= np.uint64(1) << np.uint64(block)
    return bits


@njit(nogil=True, error_model="numpy")
def _blend_tile(members, start, stop, splats, features, left, top, width, values, rows):
    """Blend one tile into `values`."""
    channels = features.shape[1]
    stride = (1 + channels) * LANES
    flat_features = features.reshape(features.size)
    zero, floor, ceiling, dark = splat(_ZERO), splat(MIN_LEVEL), splat(MAX_ALPHA32), splat(MIN_TRANSMITTANCE32)
    live = live_blocks(values, stride)
    for i in range(start, stop):
        if (i - start) % CHECK_EVERY == CHECK_EVERY - 1:
            live = live_blocks(values, stride)
            if live == 0:
                return
        g = np.int64(members[i])
        feature = g * channels
        minus_across = splat(-splats[g, ACROSS])
        blocks = live & touched_blocks(splats, g, left, top, width, rows)
        while blocks != 0:
            block = lowest_bit(blocks)
            blocks &= blocks - np.uint64(1)
            row, place = block // BLOCKS_A_ROW, block * stride
            dx = ramp(np.float32((block % BLOCKS_A_ROW) * LANES) - rows[CENTER + row])
            exponent = fma(mul(minus_across, dx), dx, spread(rows, PEAK + row))
            alpha = select(greater(exponent, floor), minimum(exp2(exponent), ceiling), zero)
            before = load(values, place)
            weight = mul(alpha, before)
            after = sub(before, weight)
            alive = greater(after, dark)
            weight = select(alive, weight, zero)
            store(values, place, select(alive, after, finished(before)))
            for channel in range(channels):
                place += LANES
                store(values, place, fma(spread(flat_features, feature + channel), weight, load(values, place)))


@njit(nogil=True, cache=True, error_model="numpy")
def blend(starts, members, splats, features, background, image, transmittance, counter):
    """Fill `image` [H, W, C] and `transmittance` [H, W] (what light is left) from tile lists; run by several threads at once."""
    height, width, channels = image.shape
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    stride = (1 + channels) * LANES
    values = np.empty((1 + channels) * AREA, np.float32)
    numbers = np.empty(ROW_NUMBERS, np.float32)
    while True:
        tile = take_ticket(counter)
        if tile >= starts.shape[0] - 1:
            break
        left, top = (tile % columns) * TILE_WIDTH, (tile // columns) * TILE_HEIGHT
        tile_width, rows = min(TILE_WIDTH, width - left), min(TILE_HEIGHT, height - top)
        start_tile(values, stride, tile_width, rows)
        _blend_tile(members, starts[tile], starts[tile + 1], splats, features, left, top, tile_width, values, numbers)
        for row in range(rows):
            for column in range(tile_width):
                place = index_of(row, column, stride)
                light = abs(values[place])
                transmittance[top + row, left + column] = light
                for channel in range(channels):
                    place += LANES
                    image[top + row, left + column, channel] = values[place] + light * background[channel]
