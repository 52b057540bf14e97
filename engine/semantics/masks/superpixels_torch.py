"""The superpixels as tensor operations, for pictures that lie on a GPU; nothing waits for the device."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.functional import pad

from degense.engine.semantics.masks.superpixels import COMPACTNESS, LINEAR, REGION_SIZE, ROUNDS

#: Linear light → (X, Y, Z) of D65, each relative to white.
XYZ = (
    (0.412453 / 0.950456, 0.357580 / 0.950456, 0.180423 / 0.950456),
    (0.212671, 0.715160, 0.072169),
    (0.019334 / 1.088754, 0.119193 / 1.088754, 0.950227 / 1.088754),
)


class Grid(NamedTuple):
    """What all pictures of a size share."""

    regions: int  # K
    start: Tensor  # int64 [K]; pixels at which the centres begin
    place: Tensor  # float32 [H · W, 2]; (x, y) in units that compare with CIELAB
    candidates: Tensor  # int64 [9, H, W]; the centres that a pixel looks at: the nine nearest; beyond the border the same ones again
    linear: Tensor  # float32 [256]
    xyz: Tensor  # float32 [3, 3]


@lru_cache(maxsize=2)
def _grid(height: int, width: int, device: torch.device) -> Grid:
    rows, columns = max(1, round(height / REGION_SIZE)), max(1, round(width / REGION_SIZE))
    y, x = torch.arange(height, device=device), torch.arange(width, device=device)
    middle_y = ((torch.arange(rows, device=device) + 0.5) * (height / rows)).long()
    middle_x = ((torch.arange(columns, device=device) + 0.5) * (width / columns)).long()
    near = torch.arange(-1, 2, device=device)
    near_rows = (y * rows // height + near[:, None]).clamp(0, rows - 1)  # [3, H]
    near_columns = (x * columns // width + near[:, None]).clamp(0, columns - 1)  # [3, W]
    return Grid(
        rows * columns,
        (middle_y[:, None] * width + middle_x).flatten(),
        torch.stack([x.repeat(height), y.repeat_interleave(width)], 1) * (COMPACTNESS / REGION_SIZE),
        (near_rows[:, None, :, None] * columns + near_columns[None, :, None, :]).reshape(9, height, width),
        torch.from_numpy(LINEAR).to(device),
        torch.tensor(XYZ, device=device),
    )


def superpixels_on_device(rgb: Tensor) -> tuple[Tensor, int]:
    """Regions of an RGB image uint8 [H, W, 3]: int64 [H, W], and their number K. Not every number need occur."""
    height, width = rgb.shape[:2]
    grid = _grid(height, width, rgb.device)
    points = torch.cat([_lab(_smooth(rgb), grid).reshape(-1, 3), grid.place], 1)  # [H · W, 5]
    centres = points[grid.start]
    half, coarse = points.view(height, width, 5)[::2, ::2].reshape(-1, 5), grid.candidates[:, ::2, ::2].reshape(9, -1)
    # in float64: a mean must not depend on the order in which threads add
    counted = torch.cat([half, half.new_ones(len(half), 1)], 1).double()
    for _ in range(ROUNDS - 1):
        sums = counted.new_zeros(grid.regions, 6).index_add_(0, _nearest(half, centres, coarse), counted)
        sizes = sums[:, 5:]
        centres = torch.where(sizes > 0, sums[:, :5] / sizes.clamp_min(1), centres).float()  # one without points stays
    return _nearest(points, centres, grid.candidates.view(9, -1)).view(height, width), grid.regions


def _nearest(points: Tensor, centres: Tensor, candidates: Tensor) -> Tensor:
    """Which of its candidates [9, n] is nearest to each point [n, 5]: int64 [n]."""
    distance = (centres[candidates] - points).square_().sum(-1)
    return candidates.gather(0, distance.argmin(0, keepdim=True))[0]


def _smooth(rgb: Tensor) -> Tensor:
    """The 3 × 3 binomial mean, rounded to whole grey levels as OpenCV does, int64 [H, W, 3]."""
    image = rgb.permute(2, 0, 1).float()
    for _ in range(2):  # along the rows, then along the columns
        wide = pad(image, (1, 1), "reflect" if image.shape[2] > 1 else "replicate")
        image = (2 * image + wide[..., :-2] + wide[..., 2:]).transpose(1, 2)
    return (image / 16 + 0.5).long().permute(1, 2, 0)


def _lab(image: Tensor, grid: Grid) -> Tensor:
    """CIELAB (D65) of sRGB bytes int64 [..., 3]."""
    xyz = (grid.linear[image][..., None, :] * grid.xyz).sum(-1)
    fx, fy, fz = torch.where(xyz > 0.008856, xyz.clamp_min(1e-9) ** (1 / 3), 7.787 * xyz + 16 / 116).unbind(-1)
    return torch.stack([116 * fy - 16, 500 * (fx - fy), 200 * (fy - fz)], -1)
