"""How far off a displacement may be: as far as motion differs between a place and what the recording reveals around it."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from degense.engine.scene.nearest import nearest

Bounds = TypeVar("Bounds", Tensor, np.ndarray)

REVEALED = 0.5  # motion observability from which a Gaussian's motion counts as shown by the recording
NEIGHBOURS = 32
SPREADS = 1.4  # so many root mean squares of the differences are the bound, which is kept in nine of ten places (docs/decisions/0038)
DOUBTFUL = 0.01  # of the scene's depth: a displacement whose bound is larger than this, and
RELATIVE = 0.5  # than this share of itself, is a guess,
SURE = 0.005  # and nine of ten of the others are within this share of the depth (docs/decisions/0038)
ROWS = 1 << 16  # Gaussians at a time


def is_guess(bound: Bounds, displacement: Bounds, depth: float) -> Bounds:
    """Which displacements are guesses, bool like `bound`, their `error_bound`; both in the unit of `depth`, the scene's."""
    return (bound > DOUBTFUL * depth) & (bound > RELATIVE * displacement)


def revealed_around(means: Float[Tensor, "n 3"], observability: Float[Tensor, " n"]) -> Int[Tensor, "n k"]:
    """For each Gaussian the nearest `NEIGHBOURS` whose motion is revealed, itself among them; k is 0 where none is."""
    known = (observability >= REVEALED).nonzero()[:, 0].cpu()
    if not len(known):
        return torch.zeros(len(means), 0, dtype=torch.int64, device=means.device)
    place = means.detach().cpu().numpy()
    rows, _ = nearest(place[known], place, NEIGHBOURS)
    return known[torch.from_numpy(rows)].to(means.device)


def error_bound(moved: Float[Tensor, "n 3"], around: Int[Tensor, "n k"], most: float) -> Float[Tensor, " n"]:
    """`SPREADS` · √(mean_j ‖u_j − u_i‖²), u the displacements since the reference frame and j `around`; at most `most`, which it is where
    nothing around is revealed.

    Where a place shows its own motion this is how well the field, which is smooth, can follow it; where it does not, how far it may be from
    what its neighbours say.
    """
    if not around.shape[1]:
        return torch.full_like(moved[:, 0], most)
    parts = zip(moved.split(ROWS), around.split(ROWS), strict=True)
    squares = torch.cat([(moved[rows] - here[:, None]).square().sum(-1).mean(1) for here, rows in parts])
    return (SPREADS * squares.sqrt()).clamp_max(most)
