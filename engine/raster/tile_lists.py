"""Which Gaussians each tile of a picture must look at, in lists of a length that is given, so that a CUDA graph can hold it.

gsplat counts the entries, waits for the number, and makes lists of that length.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor


class TileLists(NamedTuple):
    """The Gaussians of each tile one after the other, nearest first, and unused entries at the end."""

    starts: Tensor  # int32 [1, rows + 1, columns]; where each tile's begin; the last row is no tile's: it holds what is unused
    members: Tensor  # int32 [room]
    needed: Tensor  # int64 []; entries that there are; those for which there is no room, the farthest ones, are left out


@torch.no_grad()
def tile_lists(centers: Tensor, radii: Tensor, depths: Tensor, tile: int, grid: tuple[int, int], room: int | None) -> TileLists:
    """Lists for a grid of (columns, rows) tiles, each so many pixels wide and high.

    A Gaussian is of all tiles that the box around its centre [N, 2], of half-width and half-height `radii` [N, 2], touches (pixels); of
    none with a radius of 0. At equal depth [N] the first of them comes first. A `room` of None is as much as is needed, a number for which
    the GPU is waited for.
    """
    columns, rows = grid
    order = torch.argsort(depths, stable=True)
    centers, radii = centers[order] / tile, radii[order].float()
    drawn = (radii > 0).all(1) & centers.isfinite().all(1)
    first, last = (centers - radii / tile).floor(), (centers + radii / tile).ceil()
    left, right = (torch.where(drawn, edge[:, 0], 0.0).clamp(0, columns).long() for edge in (first, last))
    top, bottom = (torch.where(drawn, edge[:, 1], 0.0).clamp(0, rows).long() for edge in (first, last))
    widths, counts = right - left, (right - left) * (bottom - top)
    ends = counts.cumsum(0)
    entry = torch.arange(int(ends[-1]) if room is None else room, device=centers.device)
    row = torch.searchsorted(ends, entry, right=True)  # which Gaussian, in order, an entry is of
    used, row = row < len(order), row.clamp_max(len(order) - 1)
    within = entry - (ends - counts)[row]
    width = widths[row].clamp_min(1)
    of_tile = (top[row] + within // width) * columns + left[row] + within % width
    unused = rows * columns + entry % columns  # in many short lists: gsplat reads through each, whether it draws anything or not
    of_tile, by_tile = torch.where(used, of_tile, unused).int().sort(stable=True)
    tiles = torch.arange((rows + 1) * columns, device=centers.device, dtype=torch.int32)
    starts = torch.searchsorted(of_tile, tiles).int().reshape(1, rows + 1, columns)
    return TileLists(starts, order[row][by_tile].int(), ends[-1])
