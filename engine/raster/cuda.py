"""The gsplat back end (CUDA).

gsplat is imported at the first drawing: its import compiles kernels wherever it finds a CUDA toolkit, GPU or not.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import ModuleType
from typing import NamedTuple

import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.errors import DegenseError
from degense.engine.raster.camera_tensors import intrinsic_matrix, view_matrix
from degense.engine.raster.limits import EPS2D, FAR, MAX_SCALE, MAX_SQUARE, MIN_QUAT, NEAR
from degense.engine.raster.tile_lists import tile_lists
from degense.engine.splats import Splats

TILE = 16
CHANNELS_AT_ONCE = 64  # more would need more shared memory than common GPUs have


class PlacedOnCuda(NamedTuple):
    """Gaussians on the screen of a camera, and by tile the list of those that it must look at, nearest first."""

    camera: Camera
    centers: Tensor  # float [1, N, 2], pixels
    conics: Tensor  # float [1, N, 3]; of the inverse of Σ'
    opacities: Tensor  # float [1, N]
    starts: Tensor  # int32 [1, rows, columns]; where the list of each tile begins in `members`
    members: Tensor  # int32 [M]
    radii: Tensor  # int32 [1, N, 2]


def rasterize_cuda(
    splats: Splats, features: Tensor, camera: Camera, background: Tensor | None, screen_offsets: Tensor | None, *, clean: bool = False
) -> tuple[Tensor, Tensor, Tensor]:
    """Image float32 [H, W, C], alpha float32 [H, W], radii int32 [N]; arguments as for `engine.raster.rasterize`."""
    if not clean:
        splats = cleaned(splats, features, screen_offsets)
    placed = project_cuda(splats, camera, screen_offsets)
    image, alpha = blend_cuda(placed, features, background)
    return image, alpha, placed.radii[0].amax(1)


class DrawnInGraph(NamedTuple):
    """A picture, and how much room the lists of its tiles need."""

    image: Tensor  # float [H, W, C]
    alpha: Tensor  # float [H, W]
    radii: Tensor  # int32 [N]
    needed: Tensor  # int64 []


def rasterize_in_graph(
    splats: Splats, features: Tensor, camera: Camera, matrices: tuple[Tensor, Tensor], screen_offsets: Tensor, room: int | None
) -> DrawnInGraph:
    """`rasterize_cuda` of clean splats, with lists of tiles that have so much `room` (`tile_lists`): what a CUDA graph can hold.

    `matrices` are the camera's view matrix and K; of the `camera` itself only the size is read.
    """
    radii, centers, depths, conics = _projected(splats, camera, matrices, screen_offsets)
    lists = tile_lists(centers[0], radii[0], depths[0], TILE, _tiles(camera), room)
    placed = PlacedOnCuda(camera, centers, conics, splats.opacities[None], lists.starts, lists.members, radii)
    return DrawnInGraph(*blend_cuda(placed, features), radii[0].amax(1), lists.needed)


def project_cuda(splats: Splats, camera: Camera, screen_offsets: Tensor | None = None) -> PlacedOnCuda:
    """The Gaussians, `cleaned` as gsplat needs them, on the screen of a camera."""
    means, opacities, device = splats.means.float(), splats.opacities.float(), splats.means.device
    if means.shape[0] == 0:  # gsplat divides by the number of Gaussians
        none = torch.zeros(0, dtype=torch.int32, device=device)
        return PlacedOnCuda(camera, means[None, :, :2], means[None], opacities[None], none, none, none.reshape(1, 0, 2))
    columns, rows = _tiles(camera)
    matrices = view_matrix(camera, device), intrinsic_matrix(camera, device)
    radii, centers, depths, conics = _projected(splats, camera, matrices, screen_offsets)
    _, keys, members = _gsplat().isect_tiles(centers, radii, depths, TILE, columns, rows, packed=False)
    starts = _gsplat().isect_offset_encode(keys, 1, columns, rows)
    return PlacedOnCuda(camera, centers, conics, opacities[None], starts, members, radii)


def _tiles(camera: Camera) -> tuple[int, int]:
    """Columns and rows of a picture's tiles."""
    return -(-camera.width // TILE), -(-camera.height // TILE)


def _projected(splats: Splats, camera: Camera, matrices: tuple[Tensor, Tensor], screen_offsets: Tensor | None) -> tuple[Tensor, ...]:
    """Radii, centres, depths and conics, [1, N, …] each; radii of 0 where a Gaussian is not drawn."""
    means, quats, scales, opacities = (tensor.float() for tensor in (splats.means, splats.quats, splats.scales, splats.opacities))
    radii, centers, depths, conics, _ = _gsplat().fully_fused_projection(
        means,
        None,
        quats,
        scales,
        *(matrix[None] for matrix in matrices),
        camera.width,
        camera.height,
        eps2d=EPS2D,
        near_plane=NEAR,
        far_plane=FAR,
        packed=False,
        opacities=opacities.detach(),
    )
    return radii, centers if screen_offsets is None else centers + screen_offsets.float()[None], depths, conics


def blend_cuda(placed: PlacedOnCuda, features: Tensor, background: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Image float32 [H, W, C] of the features [N, C] of placed Gaussians, and alpha float32 [H, W]."""
    features, background = features.float(), None if background is None else background.float()
    if features.shape[0] == 0:
        return _empty(features, placed.camera, background)
    images, alphas = [], []
    for first in range(0, features.shape[1], CHANNELS_AT_ONCE):
        channels = slice(first, first + CHANNELS_AT_ONCE)
        image, alpha = _gsplat().rasterize_to_pixels(
            placed.centers,
            placed.conics,
            features[None, :, channels],
            placed.opacities,
            placed.camera.width,
            placed.camera.height,
            TILE,
            placed.starts,
            placed.members,
            backgrounds=None if background is None else background[None, channels],
        )
        images.append(image[0])
        alphas.append(alpha[0, :, :, 0])
    return (images[0] if len(images) == 1 else torch.cat(images, 2)), alphas[0]


def cleaned(splats: Splats, features: Tensor | None = None, screen_offsets: Tensor | None = None) -> Splats:
    """The splats with quaternions, scales and opacities that gsplat can take.

    Zero quaternions become the identity, scales are bounded, opacities clamped to [0, 1], and 0 for a Gaussian with anything not finite:
    gsplat then never looks at it, forward or backward.
    """
    parts = [splats.means, splats.quats, splats.scales, splats.opacities[:, None]]
    parts += [part for part in (features, screen_offsets) if part is not None]
    length = torch.linalg.vector_norm(torch.cat([part.detach().float() for part in parts], 1), dim=1)
    opacities = torch.where(length <= MAX_SQUARE**0.5, splats.opacities.float().clamp(0, 1), 0.0)
    quats = splats.quats.float()
    quats = torch.where(torch.linalg.vector_norm(quats, dim=1, keepdim=True) < MIN_QUAT, _identity(quats.device), quats)
    return replace(splats, quats=quats, scales=splats.scales.float().clamp(-MAX_SCALE, MAX_SCALE), opacities=opacities)


def _empty(features: Tensor, camera: Camera, background: Tensor | None) -> tuple[Tensor, Tensor]:
    """The picture of no Gaussians, tied to its inputs for autograd."""
    image = features.sum(0) + features.new_zeros(camera.height, camera.width, 1)
    return (image if background is None else image + background), features.new_zeros(camera.height, camera.width)


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
