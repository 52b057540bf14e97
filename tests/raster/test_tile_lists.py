"""Lists of tiles hold what a loop over Gaussians and tiles finds, in its order, and what gsplat lists on a GPU."""

import math
from itertools import pairwise

import pytest
import torch

from degense.engine.raster.tile_lists import tile_lists

TILE, GRID = 16, (5, 4)


def scattered(count, device="cpu"):
    """Centres, radii and depths of Gaussians on and around a picture; some are not drawn, some as deep as others."""
    centers = torch.rand(count, 2) * torch.tensor([120.0, 100.0]) - 20
    radii = torch.randint(0, 30, (count, 2), dtype=torch.int32)
    depths = torch.randint(1, 9, (count,)) / 4
    centers[radii[:, 0] == 0], depths[radii[:, 0] == 0] = math.nan, math.nan  # gsplat leaves what it does not draw as it lies in memory
    return [values.to(device) for values in (centers, radii, depths)]


def looped(centers, radii, depths):
    """The Gaussians of each tile, nearest first."""
    columns, rows = GRID
    lists = [[] for _ in range(rows * columns)]
    for i in sorted(range(len(centers)), key=lambda i: (depths[i].item() if radii[i].gt(0).all() else 0, i)):
        if radii[i].gt(0).all():
            (left, right), (top, bottom) = (
                (max(0, math.floor((at - reach) / TILE)), math.ceil((at + reach) / TILE))
                for at, reach in zip(centers[i].tolist(), radii[i].tolist(), strict=True)
            )
            for row in range(top, min(bottom, rows)):
                for column in range(left, min(right, columns)):
                    lists[row * columns + column].append(i)
    return lists


def split(found):
    """Members by tile, and what is unused."""
    starts = [*found.starts.flatten().tolist(), len(found.members)]
    lists = [found.members[a:b].tolist() for a, b in pairwise(starts)]
    count = GRID[0] * GRID[1]
    return lists[:count], sum(map(len, lists[count:]))


@pytest.mark.parametrize("count", [1, 3, 200])
@pytest.mark.parametrize("spare", [0, 37, None])
def test_each_tile_lists_what_touches_it_nearest_first(count, spare):
    given = scattered(count)
    expected = looped(*given)
    needed = sum(map(len, expected))
    found = tile_lists(*given, TILE, GRID, None if spare is None else needed + spare)
    lists, unused = split(found)
    assert lists == expected
    assert (int(found.needed), unused) == (needed, spare or 0)
    assert found.starts.shape == (1, GRID[1] + 1, GRID[0])


def test_what_is_not_finite_is_in_no_list():
    centers, radii, depths = scattered(50)
    centers[:25:2], centers[1:25:2], radii[:25] = math.nan, math.inf, 40
    lists, _ = split(tile_lists(centers, radii, depths, TILE, GRID, None))
    radii[:25] = 0
    assert lists == looped(centers, radii, depths)


def test_where_there_is_too_little_room_the_farthest_are_left_out_and_it_says_so():
    centers, radii, depths = scattered(200)
    whole = tile_lists(centers, radii, depths, TILE, GRID, None)
    room = int(whole.needed) // 2
    part = tile_lists(centers, radii, depths, TILE, GRID, room)
    assert int(part.needed) == int(whole.needed) > len(part.members) == room
    left = set(whole.members.tolist()) - set(part.members.tolist())
    assert left
    assert depths[list(left)].min() >= depths[part.members.long()].max()


@pytest.mark.cuda
def test_they_are_gsplats():
    import gsplat

    centers, radii, depths = scattered(5000, "cuda")
    found = tile_lists(centers, radii, depths, TILE, GRID, 100_000)
    _, keys, members = gsplat.isect_tiles(centers[None], radii[None], depths[None], TILE, *GRID, packed=False)
    starts = gsplat.isect_offset_encode(keys, 1, *GRID)
    assert int(found.needed) == len(members) < 100_000
    assert torch.equal(found.members[: len(members)], members)
    assert torch.equal(found.starts[:, : GRID[1]], starts)
