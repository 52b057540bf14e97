"""Which Gaussians each tile must look at, nearest first."""

from __future__ import annotations

import numpy as np
from numba import njit

from degense.engine.raster.project import BOTTOM, LEFT, RIGHT, TOP

_DIGIT = 11
_BUCKETS = 1 << _DIGIT


@njit(nogil=True, cache=True, error_model="numpy")
def sort_by_depth(tiles, depths):
    """Indices of the Gaussians that touch a tile, nearest first, ties by index: a radix sort on the bits of the (positive) depths."""
    bits = depths.view(np.uint32)
    order = np.empty(tiles.shape[0], np.int32)
    spare = np.empty(tiles.shape[0], np.int32)
    count = 0
    for g in range(tiles.shape[0]):
        if tiles[g, LEFT] < tiles[g, RIGHT] and tiles[g, TOP] < tiles[g, BOTTOM]:
            order[count] = g
            count += 1
    places = np.empty(_BUCKETS + 1, np.int64)
    for shift in range(0, 32, _DIGIT):
        places[:] = 0
        for i in range(count):
            places[((bits[order[i]] >> np.uint32(shift)) & np.uint32(_BUCKETS - 1)) + 1] += 1
        for bucket in range(_BUCKETS):
            places[bucket + 1] += places[bucket]
        for i in range(count):
            g = order[i]
            bucket = (bits[g] >> np.uint32(shift)) & np.uint32(_BUCKETS - 1)
            spare[places[bucket]] = g
            places[bucket] += 1
        order, spare = spare, order
    return order[:count]


@njit(nogil=True, cache=True, error_model="numpy")
def bin_by_tile(order, tiles, columns, rows):
    """Lists of Gaussians by tile (row after row): tile t has `members[starts[t] : starts[t + 1]]`, in `order`."""
    starts = np.zeros(columns * rows + 1, np.int64)
    for g in order:
        for row in range(tiles[g, TOP], tiles[g, BOTTOM]):
            for column in range(tiles[g, LEFT], tiles[g, RIGHT]):
                starts[row * columns + column + 1] += 1
    for tile in range(columns * rows):
        starts[tile + 1] += starts[tile]
    members = np.empty(starts[columns * rows], np.int32)
    ends = starts[:-1].copy()
    for g in order:
        for row in range(tiles[g, TOP], tiles[g, BOTTOM]):
            for column in range(tiles[g, LEFT], tiles[g, RIGHT]):
                tile = row * columns + column
                members[ends[tile]] = g
                ends[tile] += 1
    return starts, members
