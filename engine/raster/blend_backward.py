"""Blending backward, front to back again.

With gᵢ = cᵢ · ∂L/∂C, the light Tᵢ that reaches Gaussian i and its weight wᵢ = αᵢ Tᵢ, a pixel's derivative is

    ∂L/∂αᵢ = Tᵢ gᵢ − Rᵢ / (1 − αᵢ),    Rᵢ = Σ_{j > i} wⱼ gⱼ + T_end (background · ∂L/∂C − ∂L/∂alpha),

and R starts as C · ∂L/∂C − T_end ∂L/∂alpha, which the forward pass knows, and loses wᵢ gᵢ at each step: nothing else has to be remembered.
Every tile writes its sums for a Gaussian to a slot of their own; a second kernel adds the slots up in a fixed order. No races, and the same
result whatever the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from degense.engine.raster.blend import (
    AREA,
    CHECK_EVERY,
    MAX_ALPHA32,
    cover,
    exponent_of,
    index_of,
    live_blocks,
    make_grid,
    place_of,
    start_tile,
    touched_blocks,
)
from degense.engine.raster.project import (
    BOTTOM,
    CHUNK,
    LEFT,
    MOMENTS,
    RIGHT,
    TILE_HEIGHT,
    TILE_WIDTH,
    TOP,
    VE,
    VEE,
    VEY,
    VY,
    VYY,
    V,
    X,
    Y,
)
from degense.engine.simd import (
    LANES,
    add,
    both,
    div,
    fma,
    greater,
    load,
    lowest_bit,
    mul,
    select,
    splat,
    spread,
    store,
    sub,
    total,
)
from degense.engine.threads import take_ticket

_HALF, _ZERO, _ONE = np.float32(0.5), np.float32(0.0), np.float32(1.0)


@njit(nogil=True, cache=True, error_model="numpy")
def first_slots(tiles, first_row, last_row):
    """Where each Gaussian's slots begin, int64 [N + 1], counting tiles in tile rows [first_row, last_row)."""
    first = np.zeros(tiles.shape[0] + 1, np.int64)
    for g in range(tiles.shape[0]):
        height = min(tiles[g, BOTTOM], last_row) - max(tiles[g, TOP], first_row)
        first[g + 1] = first[g] + max(0, height) * (tiles[g, RIGHT] - tiles[g, LEFT])
    return first


@njit(nogil=True, error_model="numpy")
def _load_tile(image, transmittance, grad_image, grad_alpha, left, top, width, rows, values, stride):
    """Numbers of a tile's blocks: transmittance (1), R, then ∂L/∂C by channel."""
    start_tile(values, stride, width, rows)
    for row in range(rows):
        for column in range(width):
            place = index_of(row, column, stride)
            behind = -transmittance[top + row, left + column] * grad_alpha[top + row, left + column]
            for channel in range(image.shape[2]):
                grad = grad_image[top + row, left + column, channel]
                behind += image[top + row, left + column, channel] * grad
                values[place + (2 + channel) * LANES] = grad
            values[place + LANES] = behind


@njit(nogil=True, error_model="numpy")
def _backward_gaussian(blocks, splats, g, x, y, features, channels, values, grid, sums, geometry):
    """Walk one Gaussian over its blocks of a tile: its moments, and its feature gradients in `sums` [C LANES]."""
    stride, feature = (2 + channels) * LANES, g * channels
    zero, one = splat(_ZERO), splat(_ONE)
    gaussian = exponent_of(splats, g, x, y, grid)
    v = ve = vee = vy = vey = vyy = zero
    sums[:] = 0.0
    while blocks != 0:
        bit = lowest_bit(blocks)
        blocks &= blocks - np.uint64(1)
        place = place_of(bit, stride)
        dx, dy, uncapped, alpha, before, weight, alive = cover(gaussian, grid, bit, values, place)
        if geometry:
            pull = zero
            for channel in range(channels):
                grad = load(values, place + (2 + channel) * LANES)
                pull = fma(spread(features, feature + channel), grad, pull)
                store(sums, channel * LANES, fma(weight, grad, load(sums, channel * LANES)))
            rest = sub(load(values, place + LANES), mul(weight, pull))
            store(values, place + LANES, rest)
            grad_alpha = sub(mul(before, pull), div(rest, sub(one, alpha)))
            grad_exponent = select(both(alive, greater(splat(MAX_ALPHA32), uncapped)), mul(alpha, grad_alpha), zero)
            by_dx, by_dy = mul(grad_exponent, dx), mul(grad_exponent, dy)
            v, ve, vy = add(v, grad_exponent), add(ve, by_dx), add(vy, by_dy)
            vee, vey, vyy = fma(by_dx, dx, vee), fma(by_dx, dy, vey), fma(by_dy, dy, vyy)
        else:
            for channel in range(channels):
                grad = load(values, place + (2 + channel) * LANES)
                store(sums, channel * LANES, fma(weight, grad, load(sums, channel * LANES)))
    return total(v), total(ve), total(vee), total(vy), total(vey), total(vyy)


@njit(nogil=True, cache=True, error_model="numpy")
def blend_backward(
    starts,
    members,
    splats,
    features,
    tiles,
    first,
    first_row,
    last_row,
    image,
    transmittance,
    grad_image,
    grad_alpha,
    slots,
    geometry,
    counter,
):
    """Fill `slots` [visits, MOMENTS + C] for tile rows [first_row, last_row); run by several threads at once.

    Without `geometry` the moments are zero.
    """
    height, width, channels = image.shape
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    stride = (2 + channels) * LANES
    values = np.empty((2 + channels) * AREA, np.float32)
    grid = make_grid()
    sums = np.empty(channels * LANES, np.float32)
    flat_features = features.reshape(features.size)
    while True:
        tile = first_row * columns + take_ticket(counter)
        if tile >= last_row * columns:
            break
        column, tile_row = tile % columns, tile // columns
        left, top = column * TILE_WIDTH, tile_row * TILE_HEIGHT
        tile_width, rows = min(TILE_WIDTH, width - left), min(TILE_HEIGHT, height - top)
        _load_tile(image, transmittance, grad_image, grad_alpha, left, top, tile_width, rows, values, stride)
        live = live_blocks(values, stride)
        for i in range(starts[tile], starts[tile + 1]):
            g = np.int64(members[i])
            slot = first[g] + (tile_row - max(first_row, tiles[g, TOP])) * (tiles[g, RIGHT] - tiles[g, LEFT]) + column - tiles[g, LEFT]
            if (i - starts[tile]) % CHECK_EVERY == CHECK_EVERY - 1 and live != 0:
                live = live_blocks(values, stride)
            blocks = np.uint64(0)
            x, y = splats[g, X] - np.float32(left) - _HALF, splats[g, Y] - np.float32(top) - _HALF
            if live != 0:
                blocks = live & touched_blocks(splats, g, x, y, tile_width)
            if blocks == 0:
                slots[slot, :] = 0.0
                continue
            moments = _backward_gaussian(blocks, splats, g, x, y, flat_features, channels, values, grid, sums, geometry)
            slots[slot, V], slots[slot, VE], slots[slot, VEE], slots[slot, VY], slots[slot, VEY], slots[slot, VYY] = moments
            for channel in range(channels):
                slots[slot, MOMENTS + channel] = total(load(sums, channel * LANES))


@njit(nogil=True, cache=True, error_model="numpy")
def add_slots(first, slots, sums, counter):
    """sums[g] += every slot of g, in order; run by several threads at once."""
    while True:
        begin = take_ticket(counter) * CHUNK
        if begin >= sums.shape[0]:
            break
        for g in range(begin, min(begin + CHUNK, sums.shape[0])):
            for slot in range(first[g], first[g + 1]):
                for i in range(sums.shape[1]):
                    sums[g, i] += slots[slot, i]
