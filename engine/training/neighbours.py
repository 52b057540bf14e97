"""Nearest neighbours of the canonical centres, for local rigidity."""

from __future__ import annotations

import torch
from scipy.spatial import cKDTree
from torch import Tensor


def nearest_neighbours(points: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """The `count` nearest other points of every point, and how much each counts: exp(−½ (distance / σ)²), σ the median neighbour distance.

    Parameters
    ----------
    points : float [N, 3]
    count : int
        Neighbours a point.

    Returns
    -------
    index : int64 [N, K]
    weight : float [N, K]
        K = min(`count`, N − 1): a single point has no neighbours.
    """
    place = points.detach().cpu().double().numpy()
    k = min(count, len(place) - 1)
    if k < 1:
        return torch.zeros(len(place), 0, dtype=torch.int64, device=points.device), torch.zeros(len(place), 0, device=points.device)
    distance, index = cKDTree(place).query(place, k + 1, workers=-1)
    distance, index = torch.from_numpy(distance[:, 1:]), torch.from_numpy(index[:, 1:])
    typical = distance.median().clamp_min(1e-9)
    return index.to(points.device), torch.exp(-0.5 * (distance / typical).square()).float().to(points.device)
