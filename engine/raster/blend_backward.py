"""Blending backward, front to back again.

With gᵢ = cᵢ · ∂L/∂C, the light Tᵢ that reaches Gaussian i and its weight wᵢ = αᵢ Tᵢ, a pixel's derivative is

    ∂L/∂αᵢ = Tᵢ gᵢ − Rᵢ / (1 − αᵢ),    Rᵢ = Σ_{j > i} wⱼ gⱼ + T_end (background · ∂L/∂C − ∂L/∂alpha),

and R starts as C · ∂L/∂C − T_end ∂L/∂alpha, which the forward pass knows, and loses wᵢ gᵢ at each step: nothing else has to be remembered.
Every tile writes its sums for a Gaussian to a slot of their own; a second kernel adds the slots up in a fixed order. No races, and the same result
whatever the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from engine.raster.blend import AREA, CHECK_EVERY, blocks_of, clear_transmittance, find_live_rows, rows_of
from engine.raster.limits import MAX_ALPHA, MIN_TRANSMITTANCE
from engine.raster.project import (
    ACROSS,
    BOTTOM,
    LEFT,
    LOG2_MIN_ALPHA,
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
)
from engine.raster.simd import (
    LANES,
    add,
    both,
    div,
    exp2,
    finished,
    fma,
    greater,
    load,
    minimum,
    mul,
    ramp,
    select,
    splat,
    store,
    sub,
    take_ticket,
    total,
)

_MIN_LEVEL = np.float32(LOG2_MIN_ALPHA)
_MAX_ALPHA = np.float32(MAX_ALPHA)
_MIN_TRANSMITTANCE = np.float32(MIN_TRANSMITTANCE)


@njit(nogil=True, cache=True, error_model="numpy")
def first_slots(tiles, first_row, last_row):
    """Where each Gaussian's slots begin, int64 [N + 1], counting tiles in tile rows [first_row, last_row)."""
    first = np.zeros(tiles.shape[0] + 1, np.int64)
    for g in range(tiles.shape[0]):
        height = min(tiles[g, BOTTOM], last_row) - max(tiles[g, TOP], first_row)
        first[g + 1] = first[g] + max(0, height) * (tiles[g, RIGHT] - tiles[g, LEFT])
    return first


@njit(nogil=True, error_model="numpy")
def _load_tile(image, transmittance, grad_image, grad_alpha, left, top, width, rows, planes, at):
    """Planes of a tile: transmittance (1), R, then ∂L/∂C by channel."""
    channels = image.shape[2]
    clear_transmittance(planes, at, width)
    planes[at + AREA : at + (2 + channels) * AREA] = 0.0
    for row in range(rows):
        for column in range(width):
            pixel = at + AREA + row * TILE_WIDTH + column
            behind = -transmittance[top + row, left + column] * grad_alpha[top + row, left + column]
            for channel in range(channels):
                grad = grad_image[top + row, left + column, channel]
                behind += image[top + row, left + column, channel] * grad
                planes[pixel + (1 + channel) * AREA] = grad
            planes[pixel] = behind


@njit(nogil=True, error_model="numpy")
def _backward_tile(
    members,
    start,
    stop,
    splats,
    features,
    first,
    tiles,
    first_tile_row,
    column,
    tile_row,
    width,
    rows,
    planes,
    at,
    live,
    sums,
    lanes,
    slots,
    geometry,
):
    """Walk one tile and write a slot for each of its Gaussians. `sums` (from `lanes`) is work space for C × LANES numbers."""
    channels = features.shape[1]
    left, top = column * TILE_WIDTH, tile_row * TILE_HEIGHT
    live[:rows] = True
    zero, one, floor, ceiling, dark = (
        splat(np.float32(0.0)),
        splat(np.float32(1.0)),
        splat(_MIN_LEVEL),
        splat(_MAX_ALPHA),
        splat(_MIN_TRANSMITTANCE),
    )
    flat_features = features.reshape(features.size)
    visible = True
    for i in range(start, stop):
        g = np.int64(members[i])
        slot = first[g] + (tile_row - max(first_tile_row, tiles[g, TOP])) * (tiles[g, RIGHT] - tiles[g, LEFT]) + column - tiles[g, LEFT]
        if visible and (i - start) % CHECK_EVERY == CHECK_EVERY - 1:
            visible = find_live_rows(planes, at, rows, live)
        if not visible:
            slots[slot, :] = 0.0
            continue
        feature = g * channels
        minus_across = splat(-splats[g, ACROSS])
        for channel in range(channels):
            store(sums, lanes + channel * LANES, zero)
        v = ve = vee = vy = vey = vyy = zero
        first_row, last_row = rows_of(splats, g, top, top + rows)
        for row in range(first_row, last_row):
            if not live[row - top]:
                continue
            first_block, last_block, center, peak, height = blocks_of(splats, g, row, left, width)
            level = splat(peak)
            row_v = row_ve = zero
            for block in range(first_block, last_block):
                pixel = at + (row - top) * TILE_WIDTH + block * LANES
                dx = ramp(np.float32(block * LANES) - center)
                exponent = fma(mul(minus_across, dx), dx, level)
                uncapped = exp2(exponent)
                alpha = minimum(uncapped, ceiling)
                before = load(planes, pixel)
                weight = mul(alpha, before)
                after = sub(before, weight)
                seen = greater(exponent, floor)
                drawn = both(seen, greater(after, dark))
                weight = select(drawn, weight, zero)
                store(planes, pixel, select(drawn, after, select(seen, finished(before), before)))
                grad_pixel = pixel + 2 * AREA
                if geometry:
                    pull = zero
                    for channel in range(channels):
                        grad = load(planes, grad_pixel + channel * AREA)
                        pull = fma(splat(flat_features[feature + channel]), grad, pull)
                        lane = lanes + channel * LANES
                        store(sums, lane, fma(weight, grad, load(sums, lane)))
                    rest = sub(load(planes, pixel + AREA), mul(weight, pull))
                    store(planes, pixel + AREA, rest)
                    grad_alpha = sub(mul(before, pull), div(rest, sub(one, alpha)))
                    grad_exponent = select(both(drawn, greater(ceiling, uncapped)), mul(alpha, grad_alpha), zero)
                    moment = mul(grad_exponent, dx)
                    row_v = add(row_v, grad_exponent)
                    row_ve = add(row_ve, moment)
                    vee = fma(moment, dx, vee)
                else:
                    for channel in range(channels):
                        lane = lanes + channel * LANES
                        store(sums, lane, fma(weight, load(planes, grad_pixel + channel * AREA), load(sums, lane)))
            if geometry:
                dy = splat(height)
                moment = mul(row_v, dy)
                v, ve, vy = add(v, row_v), add(ve, row_ve), add(vy, moment)
                vey, vyy = fma(row_ve, dy, vey), fma(moment, dy, vyy)
        slots[slot, V], slots[slot, VE], slots[slot, VEE] = total(v), total(ve), total(vee)
        slots[slot, VY], slots[slot, VEY], slots[slot, VYY] = total(vy), total(vey), total(vyy)
        for channel in range(channels):
            slots[slot, MOMENTS + channel] = total(load(sums, lanes + channel * LANES))


@njit(nogil=True, parallel=True, cache=True, error_model="numpy")
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
    planes,
    lives,
    slots,
    counter,
    geometry,
):
    """Fill `slots` [tile visits, MOMENTS + C] for tile rows [first_row, last_row); the moments are zero unless `geometry`.

    `planes` [threads, (2 + C) AREA + C LANES] and `lives` [threads, TILE_HEIGHT] are work space, `counter` [1] is zero.
    """
    height, width, channels = image.shape
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    flat = planes.reshape(planes.size)
    for thread in prange(planes.shape[0]):
        at = thread * planes.shape[1]
        while True:
            tile = first_row * columns + take_ticket(counter)
            if tile >= last_row * columns:
                break
            column, row = tile % columns, tile // columns
            left, top = column * TILE_WIDTH, row * TILE_HEIGHT
            tile_width, rows = min(TILE_WIDTH, width - left), min(TILE_HEIGHT, height - top)
            _load_tile(image, transmittance, grad_image, grad_alpha, left, top, tile_width, rows, flat, at)
            _backward_tile(
                members, starts[tile], starts[tile + 1], splats, features, first, tiles, first_row, column, row, tile_width, rows,
                flat, at, lives[thread], flat, at + (2 + channels) * AREA, slots, geometry,
            )  # fmt: skip


@njit(nogil=True, parallel=True, cache=True, error_model="numpy")
def add_slots(first, slots, sums):
    """sums[g] += every slot of g, in order."""
    for g in prange(sums.shape[0]):
        for slot in range(first[g], first[g + 1]):
            for i in range(sums.shape[1]):
                sums[g, i] += slots[slot, i]
