"""The gsplat back end (CUDA).

gsplat is imported at the first drawing: its import compiles kernels wherever it finds a CUDA toolkit, GPU or not.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import ModuleType

import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.errors import DegenseError
from degense.engine.raster.camera_tensors import intrinsic_matrix, view_matrix
from degense.engine.raster.limits import EPS2D, FAR, MAX_SCALE, MAX_SQUARE, MIN_QUAT, NEAR
from degense.engine.splats import Splats

TILE = 16
CHANNELS_AT_ONCE = 64  # more would need more shared memory than common GPUs have


def rasterize_cuda(
    splats: Splats, features: Tensor, camera: Camera, background: Tensor | None, screen_offsets: Tensor | None, *, clean: bool = False
) -> tuple[Tensor, Tensor, Tensor]:
    """Image float32 [H, W, C], alpha float32 [H, W], radii int32 [N]; arguments as for `engine.raster.rasterize`."""
    if not clean:
        splats = cleaned(splats, features, screen_offsets)
    width, height, device = camera.width, camera.height, features.device
    means, quats, scales, opacities = (tensor.float() for tensor in (splats.means, splats.quats, splats.scales, splats.opacities))
    features = features.float()
    background = None if background is None else background.float()
    if means.shape[0] == 0:  # gsplat divides by the number of Gaussians
        return _empty(features, camera, background)
    gsplat = _gsplat()

    radii, centers, depths, conics, _ = gsplat.fully_fused_projection(
        means,
        None,
        quats,
        scales,
        view_matrix(camera, device)[None],
        intrinsic_matrix(camera, device)[None],
        width,
        height,
        eps2d=EPS2D,
        near_plane=NEAR,
        far_plane=FAR,
        packed=False,
        opacities=opacities.detach(),
    )
    if screen_offsets is not None:
        centers = centers + screen_offsets.float()[None]
    columns, rows = -(-width // TILE), -(-height // TILE)
    _, keys, members = gsplat.isect_tiles(centers, radii, depths, TILE, columns, rows, packed=False)
    starts = gsplat.isect_offset_encode(keys, 1, columns, rows)

    images, alphas = [], []
    for first in range(0, features.shape[1], CHANNELS_AT_ONCE):
        channels = slice(first, first + CHANNELS_AT_ONCE)
        image, alpha = gsplat.rasterize_to_pixels(
            centers,
            conics,
            features[None, :, channels],
            opacities[None],
            width,
            height,
            TILE,
            starts,
            members,
            backgrounds=None if background is None else background[None, channels],
        )
        images.append(image[0])
        alphas.append(alpha[0, :, :, 0])
    return (images[0] if len(images) == 1 else torch.cat(images, 2)), alphas[0], radii[0].amax(1)


def cleaned(splats: Splats, features: Tensor, screen_offsets: Tensor | None = None) -> Splats:
    """The splats with quaternions, scales and opacities that gsplat can take.

    Zero quaternions become the identity, scales are bounded, opacities clamped to [0, 1], and 0 for a Gaussian with anything not finite:
    gsplat then never looks at it, forward or backward.
    """
    parts = [splats.means, splats.quats, splats.scales, splats.opacities[:, None], features]
    if screen_offsets is not None:
        parts.append(screen_offsets)
    length = torch.linalg.vector_norm(torch.cat([part.detach().float() for part in parts], 1), dim=1)
    opacities = torch.where(length <= MAX_SQUARE**0.5, splats.opacities.float().clamp(0, 1), 0.0)
    quats = splats.quats.float()
    quats = torch.where(torch.linalg.vector_norm(quats, dim=1, keepdim=True) < MIN_QUAT, _identity(quats.device), quats)
    return replace(splats, quats=quats, scales=splats.scales.float().clamp(-MAX_SCALE, MAX_SCALE), opacities=opacities)


def _empty(features: Tensor, camera: Camera, background: Tensor | None) -> tuple[Tensor, Tensor, Tensor]:
    """The picture of no Gaussians, tied to its inputs for autograd."""
    image = features.sum(0) + features.new_zeros(camera.height, camera.width, 1)
    if background is not None:
        image = image + background
    return image, features.new_zeros(camera.height, camera.width), torch.zeros(0, dtype=torch.int32, device=features.device)


@lru_cache
def _gsplat() -> ModuleType:
    """gsplat with its kernels loaded, or a sentence that says what is missing."""
    advice = "install a CUDA toolkit that fits torch's CUDA version, or choose the device cpu"
    try:
        import gsplat
        from gsplat.cuda._backend import _C
    except (ImportError, OSError, RuntimeError) as error:
        raise DegenseError(f"gsplat's CUDA kernels could not be built ({str(error).splitlines()[0]}); {advice}") from error
    if _C is None:
        raise DegenseError(f"gsplat found no CUDA toolkit to build its kernels with; {advice}")
    return gsplat


@lru_cache
def _identity(device: torch.device) -> Tensor:
    with torch.inference_mode(False):
        return torch.tensor([1.0, 0.0, 0.0, 0.0], device=device)
