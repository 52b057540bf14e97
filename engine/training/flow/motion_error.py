"""How far the motion of Gaussians is from what optical flow, and measured depth at its ends, say."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from degense.engine.raster.camera_tensors import project, unproject
from degense.engine.training.flow.supervision import STEADY

DEPTH_TOLERANCE = 0.03  # of the depth: a Gaussian farther from the drawn surface is hidden and says nothing
UNSEEN = 0.2  # how much motion along the line of sight counts where no depth measures it
SOFTNESS = 0.0005  # scene units (median depth 1) below which the robust norm is quadratic: flow is mostly right, and far off in places


def motion_error(
    here: Tensor,
    there: Tensor,
    visible: Tensor,
    camera: Tensor,
    other: Tensor,
    flow: Tensor,
    weight: Tensor,
    precision: Tensor,
    trust: Tensor,
    before: Tensor | None = None,
    after: Tensor | None = None,
    gone_before: Tensor | None = None,
    gone_after: Tensor | None = None,
) -> Tensor:
    """Robust distance between the model's motion and the observed one, times its precision, averaged over visible Gaussians whose flow is
    known.

    Across the line of sight a point must follow the flow. Along it, it must come and go as the depth of all frames together says; else with
    the measured depth as far as that can be trusted, and otherwise is mildly pulled to stay: what a noisy depth seems to do between two
    frames is shrunk towards nothing.

    `here` and `there` are centres [N, 3] at the times of two frames, `visible` [N] is 0 for a hidden Gaussian and 1 for one on the surface.
    `camera` and `other` [5, 4] are `view_and_lens` at both frames, `before` and `after` [H, W] their measured depth, 0 where unknown, and
    `trust`, float [], is `FlowSupervision.depth_precision`. `gone_before` and `gone_after` [h, w] are `motion_along_sight` of both.
    Flow and its weights are float16, as in `Pair`.
    """
    start = project(here.detach(), camera)[0]
    grid = start * 2 - 1
    target = start + look_up(flow.float(), grid)
    reliable = (look_up(weight.float(), grid)[:, 0] > 0.99) * visible  # at all four pixels around, but for rounding
    sight = other[2, :3]
    along = (there - here) @ sight
    if before is not None and after is not None:
        z_before = look_up(before[None], grid)[:, 0]
        z_after = look_up(after[None], target * 2 - 1)[:, 0]
        reliable = reliable * (z_before > 0) * (z_after > 0) * ((z_after - z_before).abs() < STEADY * z_before)
        if gone_before is None or gone_after is None:
            gone = trust * ((unproject(target, z_after, other) - unproject(start, z_before, camera)) @ sight)
        else:
            gone = look_up(gone_after.float()[None], target * 2 - 1)[:, 0] - look_up(gone_before.float()[None], grid)[:, 0]
        along = along - gone
    across = _beside(there, target, other, trust) - _beside(here, start, camera, trust)
    error = torch.cat([across, (along * (UNSEEN + (1 - UNSEEN) * trust))[:, None]], 1)
    error = torch.where(reliable[:, None] > 0, error, 0.0)  # elsewhere it may be beyond all numbers, which no weight would undo
    distance = (error.square().sum(1) + SOFTNESS**2).sqrt() - SOFTNESS
    return (distance * look_up(precision.float(), grid)[:, 0] * reliable).sum() / reliable.sum().clamp_min(1)


def _beside(points: Tensor, position: Tensor, camera: Tensor, trust: Tensor) -> Tensor:
    """How far points [N, 3] are seen beside image positions (fractions) [N, 2], in scene units at their own depth; [N, 2].

    No gradient runs along a point's line of sight, where it could change nothing; as far as depth is trusted, none changes its depth.
    """
    local = points @ camera[:3, :3].T + camera[:3, 3]
    z = local[:, 2:].clamp_min(1e-3)
    return (local[:, :2] / (z + trust * (z.detach() - z)) - (position - camera[4, 2:]) / camera[4, :2]) * z.detach()


def surface_visibility(means: Tensor, opacities: Tensor, radii: Tensor, depth: Tensor, alpha: Tensor, camera: Tensor) -> Tensor:
    """1 for Gaussians that are drawn, lie on the drawn surface (within 3 % of its depth) and are not faint; else 0. Float [N], no gradient.

    `depth` and `alpha` [H, W] are blended z (not divided) and coverage, `camera` [5, 4] is `view_and_lens`.
    """
    position, z = project(means.detach(), camera)
    surface = look_up((depth / alpha.clamp_min(1e-6)).detach()[None], position * 2 - 1)[:, 0]
    return ((z - surface).abs() < DEPTH_TOLERANCE * surface).float() * (radii > 0) * (opacities.detach() > 0.1)


def look_up(image: Tensor, grid: Tensor) -> Tensor:
    """Bilinear samples [N, C] of `image` [C, H, W] at `grid` [N, 2] in [-1, 1]; 0 outside."""
    return F.grid_sample(image[None], grid[None, None].to(image.dtype), align_corners=False)[0, :, 0].T
