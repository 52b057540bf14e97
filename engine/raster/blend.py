"""Blending forward: every tile walks its Gaussians from the nearest, sixteen pixels at a time.

A tile is 8 × 4 blocks of 8 × 2 pixels, so that a set of its blocks fits one 64-bit number. A Gaussian visits only the blocks that
its ellipse of alpha ≥ MIN_ALPHA touches and that are not finished yet. A block's numbers lie side by side in the cache: its
transmittances, then its values of each channel. A finished pixel's transmittance is kept with its sign turned, so that it passes
no test again.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from degense.engine.raster.limits import MAX_ALPHA, MIN_TRANSMITTANCE
from degense.engine.raster.project import ACROSS, ALONG, HEADROOM, LOG2_MIN_ALPHA, SHEAR, TILE_HEIGHT, TILE_WIDTH, WIDTH, X, Y
from degense.engine.simd import (
    LANES,
    add,
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
    spans_as_bits,
    splat,
    spread,
    sqrt,
    store,
    sub,
)
from degense.engine.threads import take_ticket

BLOCK_WIDTH, BLOCK_HEIGHT = 8, 2
AREA = TILE_WIDTH * TILE_HEIGHT
CHECK_EVERY = 16  # Gaussians between two looks at which blocks of a tile are finished

# Constants of the pixel grid, float32 [GRID_NUMBERS]: x and y of a block's pixels from its first, then x and y of each block from
# the tile's first pixel. A block is named by its bit: 8 (row of blocks) + column of blocks.
GRID_X, GRID_Y, GRID_BLOCK_X, GRID_BLOCK_Y = 0, LANES, 2 * LANES, 2 * LANES + 64
GRID_NUMBERS = 2 * LANES + 2 * 64

MIN_LEVEL = np.float32(LOG2_MIN_ALPHA)
MAX_ALPHA32 = np.float32(MAX_ALPHA)
MIN_TRANSMITTANCE32 = np.float32(MIN_TRANSMITTANCE)
_HALF, _ZERO, _ONE = np.float32(0.5), np.float32(0.0), np.float32(1.0)
_SLACK = np.float32(1e-3)  # pixels; the exact test is made at each pixel
_EVEN_ROWS = np.uint64(0x0F0F0F0F0F0F0F0F)


@njit(nogil=True, error_model="numpy")
def make_grid():
    """The constants of the pixel grid."""
    grid = np.empty(GRID_NUMBERS, np.float32)
    for i in range(LANES):
        grid[GRID_X + i] = i % BLOCK_WIDTH
        grid[GRID_Y + i] = i // BLOCK_WIDTH
    for bit in range(64):
        grid[GRID_BLOCK_X + bit] = (bit % 8) * BLOCK_WIDTH
        grid[GRID_BLOCK_Y + bit] = (bit // 8) * BLOCK_HEIGHT
    return grid


@njit(nogil=True, error_model="numpy")
def touched_blocks(splats, g, x, y, width):
    """The blocks of a tile that a Gaussian touches, uint64; its centre lies x, y from the centre of the tile's first pixel."""
    dy = ramp(-y)
    room = fma(mul(splat(-splats[g, ALONG]), dy), dy, splat(splats[g, HEADROOM]))
    center = fma(splat(splats[g, SHEAR]), dy, splat(x))
    zero, none = splat(_ZERO), splat(-_ONE)
    half = add(sqrt(mul(maximum(room, zero), splat(splats[g, WIDTH]))), splat(_SLACK))
    low = minimum(maximum(sub(center, half), zero), splat(np.float32(width)))
    high = maximum(minimum(add(center, half), splat(np.float32(width - 1))), none)
    bits = spans_as_bits(low, select(greater(room, zero), high, none))
    return (bits | bits >> np.uint64(4)) & _EVEN_ROWS


@njit(nogil=True, error_model="numpy")
def index_of(row, column, stride):
    """Where a pixel's transmittance lies in a tile whose blocks have `stride` numbers; its other numbers follow at steps of LANES."""
    block = (row // BLOCK_HEIGHT) * 4 + column // BLOCK_WIDTH
    return block * stride + (row % BLOCK_HEIGHT) * BLOCK_WIDTH + column % BLOCK_WIDTH


@njit(nogil=True, error_model="numpy")
def place_of(bit, stride):
    """Where the block of a bit begins."""
    return ((bit >> 3) * 4 + (bit & 7)) * stride


@njit(nogil=True, error_model="numpy")
def start_tile(values, stride, width, rows):
    """Set a tile's numbers to zero but the transmittances: 1 where there is a pixel, finished where there is none."""
    values[:] = _ZERO
    for row in range(TILE_HEIGHT):
        for column in range(TILE_WIDTH):
            values[index_of(row, column, stride)] = _ONE if row < rows and column < width else -_ONE


@njit(nogil=True, error_model="numpy")
def live_blocks(values, stride):
    """Blocks with an unfinished pixel, uint64."""
    zero, bits = splat(_ZERO), np.uint64(0)
    for row in range(TILE_HEIGHT // BLOCK_HEIGHT):
        for column in range(TILE_WIDTH // BLOCK_WIDTH):
            bit = 8 * row + column
            if some(greater(load(values, place_of(bit, stride)), zero)):
                bits |= np.uint64(1) << np.uint64(bit)
    return bits


@njit(nogil=True, error_model="numpy")
def exponent_of(splats, g, x, y, grid):
    """What `cover` must know of a Gaussian whose centre lies x, y from the centre of a tile's first pixel."""
    from_x, from_y = sub(load(grid, GRID_X), splat(x)), sub(load(grid, GRID_Y), splat(y))
    minus_shear, minus_across, minus_along = splat(-splats[g, SHEAR]), splat(-splats[g, ACROSS]), splat(-splats[g, ALONG])
    return from_x, from_y, minus_shear, minus_across, minus_along, splat(splats[g, HEADROOM] + MIN_LEVEL)


@njit(nogil=True, error_model="numpy")
def cover(gaussian, grid, bit, values, place):
    """Take a Gaussian's light from a block, the one of a bit, whose transmittances lie at `place`.

    Its pixels' dx − k dy and dy, α before and after it is capped, the light that reached it, its weight, and where that counts.
    """
    from_x, from_y, minus_shear, minus_across, minus_along, peak = gaussian
    zero = splat(_ZERO)
    dy = add(from_y, spread(grid, GRID_BLOCK_Y + bit))
    dx = fma(minus_shear, dy, add(from_x, spread(grid, GRID_BLOCK_X + bit)))
    exponent = fma(mul(minus_across, dx), dx, fma(mul(minus_along, dy), dy, peak))
    uncapped = exp2(exponent)
    alpha = select(greater(exponent, splat(MIN_LEVEL)), minimum(uncapped, splat(MAX_ALPHA32)), zero)
    before = load(values, place)
    weight = mul(alpha, before)
    after = sub(before, weight)
    alive = greater(after, splat(MIN_TRANSMITTANCE32))
    store(values, place, select(alive, after, finished(before)))
    return dx, dy, uncapped, alpha, before, select(alive, weight, zero), alive


@njit(nogil=True, error_model="numpy")
def _blend_tile(members, start, stop, splats, features, left, top, width, values, grid):
    """Blend one tile into `values`."""
    channels = features.shape[1]
    stride = (1 + channels) * LANES
    flat_features = features.reshape(features.size)
    live = live_blocks(values, stride)
    for i in range(start, stop):
        if (i - start) % CHECK_EVERY == CHECK_EVERY - 1:
            live = live_blocks(values, stride)
            if live == 0:
                return
        g = np.int64(members[i])
        feature = g * channels
        x, y = splats[g, X] - np.float32(left) - _HALF, splats[g, Y] - np.float32(top) - _HALF
        blocks = live & touched_blocks(splats, g, x, y, width)
        gaussian = exponent_of(splats, g, x, y, grid)
        while blocks != 0:
            bit = lowest_bit(blocks)
            blocks &= blocks - np.uint64(1)
            place = place_of(bit, stride)
            weight = cover(gaussian, grid, bit, values, place)[5]
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
    grid = make_grid()
    while True:
        tile = take_ticket(counter)
        if tile >= starts.shape[0] - 1:
            break
        left, top = (tile % columns) * TILE_WIDTH, (tile // columns) * TILE_HEIGHT
        tile_width, rows = min(TILE_WIDTH, width - left), min(TILE_HEIGHT, height - top)
        start_tile(values, stride, tile_width, rows)
        _blend_tile(members, starts[tile], starts[tile + 1], splats, features, left, top, tile_width, values, grid)
        for row in range(rows):
            for column in range(tile_width):
                place = index_of(row, column, stride)
                light = abs(values[place])
                transmittance[top + row, left + column] = light
                for channel in range(channels):
                    place += LANES
                    image[top + row, left + column, channel] = values[place] + light * background[channel]
