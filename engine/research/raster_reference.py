"""The oracle: every Gaussian against every pixel in float64 torch. Slow, plain, differentiable by autograd alone.

`rasterize(…, backend="reference")` draws with it once `bench.raster_scenes` is imported.
"""

from __future__ import annotations

import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.raster.limits import (
    EPS2D,
    FAR,
    FOV_MARGIN,
    MAX_ALPHA,
    MAX_EXTENT,
    MAX_SCALE,
    MAX_SQUARE,
    MIN_ALPHA,
    MIN_QUAT,
    MIN_TRANSMITTANCE,
    NEAR,
)
from degense.engine.splats import Splats

PAIRS_AT_ONCE = 4_000_000


def rasterize_reference(
    splats: Splats,
    features: Tensor,
    camera: Camera,
    background: Tensor | None,
    screen_offsets: Tensor | None,
    *,
    clean: bool = False,
    window: tuple[int, int, int, int] | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Image float64 [H, W, C], alpha float64 [H, W], radii int32 [N]; arguments as for `engine.raster.rasterize`, any float type.

    `clean` makes no difference.

    With a `window` (left, top, width, height; pixels) only that part of the picture is drawn, exactly as it is in the whole.
    """
    inputs = (splats.means, splats.quats, splats.scales, splats.opacities, features)
    means, quats, scales, opacities, features = (tensor.double() for tensor in inputs)
    per_gaussian = [means, quats, scales, opacities[:, None], features]
    if screen_offsets is not None:
        screen_offsets = screen_offsets.double()
        per_gaussian.append(screen_offsets)
    drawn = torch.stack([tensor.square().sum(1) <= MAX_SQUARE for tensor in per_gaussian]).all(0)

    # Gaussians that are not drawn take no part from here on, so that nothing of theirs, NaN least of all, reaches a gradient.
    index = drawn.nonzero()[:, 0]
    means, quats, scales, opacities, features = means[index], quats[index], scales[index], opacities[index].clamp(0, 1), features[index]
    center, depth, covariance, precision = project(means, quats, scales, camera)
    if screen_offsets is not None:
        center = center + screen_offsets[index]

    radii = _radii(center, depth, covariance, opacities, camera)
    visible = (radii > 0).nonzero()[:, 0]
    visible = visible[torch.sort(depth[visible].float(), stable=True).indices]
    window = window or (0, 0, camera.width, camera.height)
    image, alpha = _blend(center[visible], precision[visible], opacities[visible], features[visible], window, background)
    all_radii = torch.zeros(drawn.shape[0], dtype=torch.int32)
    all_radii[index] = radii
    return image, alpha, all_radii


def project(means: Tensor, quats: Tensor, scales: Tensor, camera: Camera) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Pixel centres [N, 2], camera z [N], pixel covariances Σ' = J W Σ Wᵀ Jᵀ + EPS2D I [N, 2, 2] of Gaussians, and their inverses.

    Centres nearer than NEAR are projected as if they were at NEAR; they are not drawn.
    """
    view = torch.from_numpy(camera.viewmat)
    local = means @ view[:3, :3].T + view[:3, 3]
    x, y, depth = local.unbind(1)
    z = depth.clamp(NEAR, FAR)

    margin_x, margin_y = FOV_MARGIN * 0.5 * camera.width / camera.fx, FOV_MARGIN * 0.5 * camera.height / camera.fy
    tx = z * (x / z).clamp(-camera.cx / camera.fx - margin_x, (camera.width - camera.cx) / camera.fx + margin_x)
    ty = z * (y / z).clamp(-camera.cy / camera.fy - margin_y, (camera.height - camera.cy) / camera.fy + margin_y)
    zero = torch.zeros_like(z)
    jacobian = torch.stack([camera.fx / z, zero, -camera.fx * tx / z**2, zero, camera.fy / z, -camera.fy * ty / z**2], 1).reshape(-1, 2, 3)

    half = jacobian @ view[:3, :3] @ rotation_matrices(quats) * scales.clamp(-MAX_SCALE, MAX_SCALE)[:, None, :]
    covariance = half @ half.mT + EPS2D * torch.eye(2, dtype=torch.float64)
    center = torch.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], 1)
    return center, depth, covariance, _precision(half, covariance)


def _precision(half: Tensor, covariance: Tensor) -> Tensor:
    """Inverse of P Pᵀ + EPS2D I, whose determinant |p₀ × p₁|² + EPS2D tr P Pᵀ + EPS2D² is summed without the cancellation of a c − b²."""
    across = torch.linalg.cross(half[:, 0], half[:, 1]).square().sum(1)
    determinant = across + EPS2D * half.square().sum((1, 2)) + EPS2D**2
    (a, b), (_, c) = (row.unbind(1) for row in covariance.unbind(1))
    return torch.stack([c, -b, -b, a], 1).reshape(-1, 2, 2) / determinant[:, None, None]


def rotation_matrices(quats: Tensor) -> Tensor:
    """[N, 3, 3] of quaternions [N, 4] wxyz of any length; those shorter than MIN_QUAT are the identity."""
    identity = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=quats.dtype)
    quats = torch.where(quats.square().sum(1, keepdim=True) < MIN_QUAT**2, identity, quats)
    w, x, y, z = (quats / quats.norm(dim=1, keepdim=True)).unbind(1)
    rows = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return torch.stack(rows, 1).reshape(-1, 3, 3)


@torch.no_grad()
def _radii(center: Tensor, depth: Tensor, covariance: Tensor, opacities: Tensor, camera: Camera) -> Tensor:
    """Half of the longer side of each Gaussian's box, int32 pixels, 0 where it is not drawn."""
    extent = (2.0 * (opacities / MIN_ALPHA).clamp(min=1.0).log()).sqrt().clamp(max=MAX_EXTENT)
    half = (extent[:, None] * covariance.diagonal(dim1=1, dim2=2).sqrt()).ceil()
    inside = ((center + half > 0) & (center - half < torch.tensor([camera.width, camera.height]))).all(1)
    drawn = inside & (depth >= NEAR) & (depth <= FAR) & (opacities >= MIN_ALPHA) & covariance.isfinite().all(2).all(1)
    return torch.where(drawn, half.amax(1).clamp(max=2**31 - 1), 0.0).to(torch.int32)


def _blend(
    center: Tensor,
    precision: Tensor,
    opacities: Tensor,
    features: Tensor,
    window: tuple[int, int, int, int],
    background: Tensor | None,
) -> tuple[Tensor, Tensor]:
    """Alpha-blend Gaussians, nearest first, over the pixels of a window, a chunk of them at a time."""
    left_edge, top, width, height = window
    ys, xs = torch.meshgrid(torch.arange(height) + top + 0.5, torch.arange(width) + left_edge + 0.5, indexing="ij")
    pixels = torch.stack([xs.reshape(-1), ys.reshape(-1)], 1).double()
    images, alphas = [], []
    for chunk in pixels.split(max(1, PAIRS_AT_ONCE // max(1, center.shape[0]))):
        offset = chunk[:, None, :] - center[None]
        sigma = 0.5 * torch.einsum("pni,nij,pnj->pn", offset, precision, offset)
        alpha = (opacities * torch.exp(-sigma)).clamp(max=MAX_ALPHA)
        alpha = torch.where(alpha >= MIN_ALPHA, alpha, 0.0)
        alpha = torch.where(torch.cumprod(1 - alpha, 1) > MIN_TRANSMITTANCE, alpha, 0.0)
        after = torch.cumprod(1 - alpha, 1)
        before = torch.cat([after.new_ones(after.shape[0], 1), after], 1)
        left = before[:, -1]
        image = (alpha * before[:, :-1]) @ features
        if background is not None:
            image = image + left[:, None] * background.double()
        images.append(image)
        alphas.append(1 - left)
    shape = (height, width)
    return torch.cat(images).reshape(*shape, features.shape[1]), torch.cat(alphas).reshape(shape)
