"""The superpixels of `engine.masks.superpixels` as tensor operations, for pictures that lie on a GPU; nothing waits for the device."""

from __future__ import annotations

import torch
from torch import Tensor

from engine.masks.superpixels import COMPACTNESS, REGION_SIZE, ROUNDS


def superpixels_on_device(rgb: Tensor, region_size: int = REGION_SIZE, compactness: float = COMPACTNESS) -> tuple[Tensor, int]:
    """Regions of an RGB image uint8 [H, W, 3]: int64 [H, W], and their number K. Not every number need occur."""
    height, width = rgb.shape[:2]
    lab = _lab(_smooth(rgb)).reshape(-1, 3)
    rows, columns = max(1, round(height / region_size)), max(1, round(width / region_size))
    y, x = torch.arange(height, device=rgb.device), torch.arange(width, device=rgb.device)
    middle_y = ((torch.arange(rows, device=rgb.device) + 0.5) * (height / rows)).long()
    middle_x = ((torch.arange(columns, device=rgb.device) + 0.5) * (width / columns)).long()
    start = (middle_y[:, None] * width + middle_x).flatten()
    points = torch.cat([lab, x.repeat(height)[:, None], y.repeat_interleave(width)[:, None]], 1)  # [H · W, 5]
    centres = points[start]
    # a pixel looks at the nine nearest centres; beyond the border at the same ones again
    near = torch.arange(-1, 2, device=rgb.device)
    near_rows = (y * rows // height + near[:, None]).clamp(0, rows - 1)  # [3, H]
    near_columns = (x * columns // width + near[:, None]).clamp(0, columns - 1)  # [3, W]
    candidates = (near_rows[:, None, :, None] * columns + near_columns[None, :, None, :]).reshape(9, height, width)
    coarse = candidates[:, ::2, ::2].reshape(9, -1)
    half = points.view(height, width, 5)[::2, ::2].reshape(-1, 5)
    weights = lab.new_tensor([1, 1, 1, compactness / region_size, compactness / region_size])
    for _ in range(ROUNDS - 1):
        centres = _moved(half, _nearest(half, centres, coarse, weights), centres)
    return _nearest(points, centres, candidates.reshape(9, -1), weights).view(height, width), rows * columns


def _nearest(points: Tensor, centres: Tensor, candidates: Tensor, weights: Tensor) -> Tensor:
    """Which of its candidates [9, n] is nearest to each point [n, 5]: int64 [n]."""
    distance = ((points - centres[candidates]) * weights).square().sum(-1)
    return candidates.gather(0, distance.argmin(0, keepdim=True))[0]


def _moved(points: Tensor, labels: Tensor, centres: Tensor) -> Tensor:
    """Means of the points [n, 5] of each centre [K, 5]; a centre without points stays."""
    sums = torch.zeros_like(centres, dtype=torch.float64).index_add_(0, labels, points.double())
    sizes = torch.zeros(len(centres), dtype=torch.float64, device=centres.device).index_add_(0, labels, sums.new_ones(len(labels)))
    return torch.where(sizes[:, None] > 0, sums / sizes.clamp_min(1)[:, None], centres).float()


def _smooth(rgb: Tensor) -> Tensor:
    """The 3 × 3 binomial mean, rounded to whole grey levels as OpenCV does, float32 [H, W, 3] in [0, 1]."""
    image = rgb.float()
    for axis, size in enumerate(rgb.shape[:2]):
        place = torch.arange(size, device=rgb.device)
        mirrored = [_mirrored(place + step, size) for step in (-1, 1)]
        image = 2 * image + image.index_select(axis, mirrored[0]) + image.index_select(axis, mirrored[1])
    return torch.floor(image / 16 + 0.5) / 255


def _mirrored(place: Tensor, size: int) -> Tensor:
    """Places −1 and `size` mirrored at the border pixel."""
    return torch.zeros_like(place) if size == 1 else torch.where(place >= size, 2 * size - 2 - place, place.abs())


def _lab(image: Tensor) -> Tensor:
    """CIELAB (D65) of sRGB float32 [..., 3] in [0, 1]."""
    linear = torch.where(image <= 0.04045, image / 12.92, ((image + 0.055) / 1.055) ** 2.4)
    matrix = (
        [[0.412453 / 0.950456, 0.357580 / 0.950456, 0.180423 / 0.950456], [0.212671, 0.715160, 0.072169],
         [0.019334 / 1.088754, 0.119193 / 1.088754, 0.950227 / 1.088754]]
    )  # fmt: skip
    r, g, b = linear.unbind(-1)
    x, y, z = (row[0] * r + row[1] * g + row[2] * b for row in matrix)
    fx, fy, fz = (torch.where(t > 0.008856, t.clamp_min(1e-9) ** (1 / 3), 7.787 * t + 16 / 116) for t in (x, y, z))
    return torch.stack([116 * fy - 16, 500 * (fx - fy), 200 * (fy - fz)], -1)
