"""How far the motion of Gaussians is from the optical flow of the frames, lifted to 3D where depth was measured."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from degense.engine.raster.camera_tensors import project, unproject
from degense.engine.training.flow.supervision import STEADY

DEPTH_TOLERANCE = 0.03  # of the depth: a Gaussian farther from the drawn surface is hidden and says nothing
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
    before: Tensor | None = None,
    after: Tensor | None = None,
) -> Tensor:
    """Robust distance between the model's motion and the observed one, times its precision, averaged over visible Gaussians whose flow is
    known.

    With measured depth the target is the 3D offset between the surface points at both ends of the flow; without it only the motion across
    the line of sight is compared, at the Gaussian's own depth.

    `here` and `there` are centres [N, 3] at the times of two frames, `visible` [N] is 0 for a hidden Gaussian and 1 for one on the surface.
    `camera` and `other` [5, 4] are `view_and_lens` at both frames, `before` and `after` [H, W] their measured depth, 0 where unknown. Flow
    and its weights are float16, as in `Pair`.
    """
    start, z = project(here, camera)
    end, z_end = project(there, other)
    grid = start.detach() * 2 - 1
    way = look_up(flow.float(), grid)
    target = start.detach() + way
    reliable = (look_up(weight.float(), grid)[:, 0] > 0.99) * visible  # at all four pixels around, but for rounding
    if before is not None and after is not None:
        z_before = look_up(before[None], grid)[:, 0]
        z_after = look_up(after[None], target * 2 - 1)[:, 0]
        reliable = reliable * (z_before > 0) * (z_after > 0) * ((z_after - z_before).abs() < STEADY * z_before)
        error = (there - here) - (unproject(target, z_after, other) - unproject(start.detach(), z_before, camera))
    else:
        lateral = ((end - start) - way) / other[4, :2] * z.detach()[:, None]
        error = torch.cat([lateral, (z_end - z)[:, None] * 0.2], 1)  # depth is unseen: a mild pull against explaining motion by it
    error = torch.where(reliable[:, None] > 0, error, 0.0)  # elsewhere it may be beyond all numbers, which no weight would undo
    distance = (error.square().sum(1) + SOFTNESS**2).sqrt() - SOFTNESS
    return (distance * look_up(precision.float(), grid)[:, 0] * reliable).sum() / reliable.sum().clamp_min(1)


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
