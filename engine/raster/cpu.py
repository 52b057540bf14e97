"""The numba back end: float32 on all cores, forward and backward of projection and blending in one autograd function.

Between the two, each tile gets its list of the Gaussians that it must look at, nearest first.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

from degense.engine.camera import Camera
from degense.engine.raster.blend import blend
from degense.engine.raster.blend_backward import add_slots, blend_backward, first_slots
from degense.engine.raster.project import BOTTOM, FIELDS, LEFT, MOMENTS, RIGHT, TILE_HEIGHT, TILE_WIDTH, TOP, project, project_backward
from degense.engine.splats import Splats
from degense.engine.threads import run_kernel

_DIGIT = 11
_BUCKETS = 1 << _DIGIT


@njit(nogil=True, cache=True, error_model="numpy")
def sort_by_depth(tiles, depths):
    """Indices of the Gaussians that touch a tile, nearest first, ties by index: a radix sort on the bits of the (positive) depths."""
    bits = depths.view(np.uint32)
    order = np.empty(tiles.shape[0], np.int32)
    spare = np.empty(tiles.shape[0], np.int32)
    count = 0
    for g in range(tiles.shape[0]):
        if tiles[g, LEFT] < tiles[g, RIGHT] and tiles[g, TOP] < tiles[g, BOTTOM]:
            order[count] = g
            count += 1
    places = np.empty(_BUCKETS + 1, np.int64)
    for shift in range(0, 32, _DIGIT):
        places[:] = 0
        for i in range(count):
            places[((bits[order[i]] >> np.uint32(shift)) & np.uint32(_BUCKETS - 1)) + 1] += 1
        for bucket in range(_BUCKETS):
            places[bucket + 1] += places[bucket]
        for i in range(count):
            g = order[i]
            bucket = (bits[g] >> np.uint32(shift)) & np.uint32(_BUCKETS - 1)
            spare[places[bucket]] = g
            places[bucket] += 1
        order, spare = spare, order
    return order[:count]


@njit(nogil=True, cache=True, error_model="numpy")
def bin_by_tile(order, tiles, columns, rows):
    """Lists of Gaussians by tile (row after row): tile t has `members[starts[t] : starts[t + 1]]`, in `order`."""
    starts = np.zeros(columns * rows + 1, np.int64)
    for g in order:
        for row in range(tiles[g, TOP], tiles[g, BOTTOM]):
            for column in range(tiles[g, LEFT], tiles[g, RIGHT]):
                starts[row * columns + column + 1] += 1
    for tile in range(columns * rows):
        starts[tile + 1] += starts[tile]
    members = np.empty(starts[columns * rows], np.int32)
    ends = starts[:-1].copy()
    for g in order:
        for row in range(tiles[g, TOP], tiles[g, BOTTOM]):
            for column in range(tiles[g, LEFT], tiles[g, RIGHT]):
                tile = row * columns + column
                members[ends[tile]] = g
                ends[tile] += 1
    return starts, members


SLOT_BYTES = 256 << 20  # the backward pass works through the picture in bands of tile rows that need no more than this


class PlacedOnCpu(NamedTuple):
    """Gaussians on the screen of a camera, and by tile the list of those that it must look at (`bin_by_tile`)."""

    width: int
    height: int
    starts: np.ndarray
    members: np.ndarray
    splats: np.ndarray  # float32 [N, FIELDS]
    tiles: np.ndarray  # int32 [N, 4]
    radii: Tensor  # int32 [N]


def rasterize_cpu(
    splats: Splats, features: Tensor, camera: Camera, background: Tensor | None, screen_offsets: Tensor | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Image float32 [H, W, C], alpha float32 [H, W], radii int32 [N]; arguments as for `engine.raster.rasterize`."""
    background = features.new_zeros(features.shape[1]) if background is None else background
    screen_offsets = features.new_zeros(0, 2) if screen_offsets is None else screen_offsets
    tensors = (splats.means, splats.quats, splats.scales, splats.opacities, features, background, screen_offsets)
    return _Rasterize.apply(camera, *(tensor.float().contiguous() for tensor in tensors))


def project_cpu(splats: Splats, camera: Camera) -> PlacedOnCpu:
    """The Gaussians on the screen of a camera, without a gradient."""
    tensors = (splats.means, splats.quats, splats.scales, splats.opacities)
    arrays = [tensor.detach().float().contiguous().numpy() for tensor in tensors]
    none = np.zeros((len(splats), 0), np.float32)
    return _place([*arrays, none, none[:0]], _view(camera), _lens(camera))


def blend_cpu(placed: PlacedOnCpu, features: Tensor) -> Tensor:
    """Image float32 [H, W, C] of the features [N, C] of placed Gaussians, which alone get a gradient."""
    return _Blend.apply(placed, features.float().contiguous())


def _view(camera: Camera) -> np.ndarray:
    return np.ascontiguousarray(camera.viewmat, np.float64)


def _lens(camera: Camera) -> np.ndarray:
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height], np.float64)


def _place(gaussians: Sequence[np.ndarray], view: np.ndarray, lens: np.ndarray) -> PlacedOnCpu:
    """Arguments as for the kernel `project`; `gaussians` are its first six."""
    count, width, height = len(gaussians[0]), int(lens[4]), int(lens[5])
    splats, tiles, depths = np.empty((count, FIELDS), np.float32), np.empty((count, 4), np.int32), np.empty(count, np.float32)
    radii = torch.empty(count, dtype=torch.int32)
    run_kernel(project, *gaussians, view, lens, splats, tiles, depths, radii.numpy())
    starts, members = bin_by_tile(sort_by_depth(tiles, depths), tiles, -(-width // TILE_WIDTH), -(-height // TILE_HEIGHT))
    return PlacedOnCpu(width, height, starts, members, splats, tiles, radii)


def _blend(placed: PlacedOnCpu, features: Tensor, background: Tensor) -> tuple[Tensor, Tensor]:
    """Image [H, W, C] and what is left of the light [H, W]."""
    image, transmittance = torch.empty(placed.height, placed.width, features.shape[1]), torch.empty(placed.height, placed.width)
    arrays = (features.detach().numpy(), background.detach().numpy(), image.numpy(), transmittance.numpy())
    run_kernel(blend, placed.starts, placed.members, placed.splats, *arrays)
    return image, transmittance


class _Rasterize(torch.autograd.Function):
    @staticmethod
    def forward(ctx, camera, means, quats, scales, opacities, features, background, offsets):
        arrays = [tensor.detach().numpy() for tensor in (means, quats, scales, opacities, features, offsets)]
        ctx.geometry = (_view(camera), _lens(camera))
        ctx.placed = _place(arrays, *ctx.geometry)
        image, transmittance = _blend(ctx.placed, features, background)
        ctx.save_for_backward(means, quats, scales, opacities, features, image, transmittance)
        ctx.mark_non_differentiable(ctx.placed.radii)
        ctx.set_materialize_grads(False)
        return image, 1.0 - transmittance, ctx.placed.radii

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_image, grad_alpha, _):
        means, quats, scales, opacities, features, image, transmittance = ctx.saved_tensors
        grad_image = torch.zeros_like(image) if grad_image is None else grad_image.contiguous()
        grad_alpha = torch.zeros_like(transmittance) if grad_alpha is None else grad_alpha.contiguous()
        _, *needs = ctx.needs_input_grad
        needs_geometry = any(needs[:4]) or needs[6]
        grads: list[Tensor | None] = [None] * 7
        if needs[5]:
            grads[5] = transmittance.reshape(1, -1).mm(grad_image.reshape(transmittance.numel(), -1))[0]
        if needs_geometry or needs[4]:
            sums = _sum_over_pixels(ctx.placed, features, image, transmittance, grad_image, grad_alpha, needs_geometry)
            if needs_geometry:
                inputs = (means, quats, scales, opacities)
                outputs = [torch.empty_like(tensor) for tensor in inputs] + [torch.empty(means.shape[0], 2)]
                arrays = [tensor.detach().numpy() for tensor in inputs]
                results = [tensor.numpy() for tensor in outputs]
                run_kernel(project_backward, *arrays, *ctx.geometry, ctx.placed.radii.numpy(), sums.numpy(), *results)
                grads[:4], grads[6] = outputs[:4], outputs[4]
            grads[4] = sums[:, MOMENTS:]
        return None, *(grad if needed else None for grad, needed in zip(grads, needs, strict=True))


class _Blend(torch.autograd.Function):
    @staticmethod
    def forward(ctx, placed, features):
        ctx.placed = placed
        image, transmittance = _blend(placed, features, features.new_zeros(features.shape[1]))
        ctx.save_for_backward(features, image, transmittance)
        return image

    @staticmethod
    @once_differentiable
    def backward(ctx, grad_image):
        features, image, transmittance = ctx.saved_tensors
        grads = (grad_image.contiguous(), torch.zeros_like(transmittance))
        return None, _sum_over_pixels(ctx.placed, features, image, transmittance, *grads, geometry=False)[:, MOMENTS:]


def _sum_over_pixels(
    placed: PlacedOnCpu,
    features: Tensor,
    image: Tensor,
    transmittance: Tensor,
    grad_image: Tensor,
    grad_alpha: Tensor,
    geometry: bool,
) -> Tensor:
    """What blending's backward pass sums for each Gaussian, float32 [N, MOMENTS + C]."""
    _, _, starts, members, splats, tiles, _ = placed
    columns, numbers = -(-image.shape[1] // TILE_WIDTH), MOMENTS + image.shape[2]
    sums = torch.zeros(features.shape[0], numbers)
    pixels = [tensor.detach().numpy() for tensor in (image, transmittance, grad_image, grad_alpha)]
    for rows in _bands(starts[::columns], SLOT_BYTES // (4 * numbers)):
        first = first_slots(tiles, *rows)
        slots = np.empty((first[-1], numbers), np.float32)
        run_kernel(blend_backward, starts, members, splats, features.detach().numpy(), tiles, first, *rows, *pixels, slots, geometry)
        run_kernel(add_slots, first, slots, sums.numpy())
    return sums


def _bands(visits: np.ndarray, limit: int) -> list[tuple[int, int]]:
    """Ranges of tile rows with at most `limit` visits each (a single row may exceed it); visits [rows + 1] counts up."""
    bands, first = [], 0
    for row in range(1, len(visits)):
        if row + 1 == len(visits) or visits[row + 1] - visits[first] > limit:
            bands.append((first, row))
            first = row
    return bands
