"""A camera in tensors, and its projection.

Matrices are kept per device: a copy to the GPU at every call would cost more than drawing.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera


def view_matrix(camera: Camera, device: torch.device, dtype: torch.dtype = torch.float32) -> Tensor:
    """World to camera, [4, 4]; not to be changed in place."""
    return _tensor(np.ascontiguousarray(camera.viewmat, np.float64).tobytes(), 4, device, dtype)


def view_and_lens(camera: Camera, device: torch.device, dtype: torch.dtype = torch.float32) -> Tensor:
    """All of a camera in one tensor, [5, 4]: its view matrix, then fx / W, fy / H, cx / W, cy / H; not to be changed in place."""
    lens = (camera.fx / camera.width, camera.fy / camera.height, camera.cx / camera.width, camera.cy / camera.height)
    return _tensor(np.vstack([camera.viewmat, lens]).tobytes(), 5, device, dtype)


def intrinsic_matrix(camera: Camera, device: torch.device, dtype: torch.dtype = torch.float32) -> Tensor:
    """K, [3, 3]; not to be changed in place."""
    return _tensor(camera.intrinsics.tobytes(), 3, device, dtype)


def camera_depths(means: Tensor, camera: Camera) -> Tensor:
    """Camera z [N] of world points [N, 3], differentiable; draw it as one more feature channel."""
    means = means if means.dtype == torch.float64 else means.float()
    row = view_matrix(camera, means.device, means.dtype)[2]
    return means @ row[:3] + row[3]


def project(points: Tensor, camera: Tensor) -> tuple[Tensor, Tensor]:
    """Image positions as fractions of width and height [N, 2], and depths z [N], seen by a camera's `view_and_lens` [5, 4]."""
    local = points @ camera[:3, :3].T + camera[:3, 3]
    z = local[:, 2].clamp_min(1e-3)
    return local[:, :2] / z[:, None] * camera[4, :2] + camera[4, 2:], z


def unproject(position: Tensor, z: Tensor, camera: Tensor) -> Tensor:
    """World points [N, 3] of image positions (fractions) [N, 2] at depths z [N]."""
    lateral = (position - camera[4, 2:]) / camera[4, :2] * z[:, None]
    return (torch.cat([lateral, z[:, None]], 1) - camera[:3, 3]) @ camera[:3, :3]


@lru_cache(maxsize=1024)
def _tensor(values: bytes, rows: int, device: torch.device, dtype: torch.dtype) -> Tensor:
    with torch.inference_mode(False):  # kept tensors must stay usable where gradients are recorded
        return torch.tensor(np.frombuffer(values).reshape(rows, -1), dtype=dtype, device=device)
