"""Random Gaussians to check and to time the back ends with."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from degense.engine.camera import Camera
from degense.engine.raster.render import BACKENDS, Render, rasterize
from degense.engine.research.raster_reference import rasterize_reference
from degense.engine.splats import Splats

BACKENDS["reference"] = rasterize_reference


def random_scene(
    count: int, width: int, height: int, channels: int, seed: int, *, footprint: float = 3.0, turned: bool = False
) -> tuple[Splats, Camera]:
    """Gaussians that fill a picture (and spill a little over its edges), and the camera that sees them.

    Their semantics are `channels` random features in [0, 1]; their colours are zero.

    Parameters
    ----------
    footprint : float
        Median standard deviation on the screen, pixels.
    turned : bool
        A camera that is rotated and moved, with unequal focal lengths and its principal point off the centre, instead of the plain one.
    """
    generator = torch.Generator().manual_seed(seed)
    focal = 0.9 * width
    camera = Camera(width, height, focal, focal, width / 2, height / 2)
    if turned:
        axis = torch.randn(3, generator=generator).double().numpy()
        camera = Camera(
            width, height, focal, 1.1 * focal, 0.45 * width, 0.6 * height, _rigid(axis / np.linalg.norm(axis), 2.0, [0.3, -0.2, 0.5])
        )
    pixels = (torch.rand(count, 2, generator=generator) * 1.2 - 0.1) * torch.tensor([width, height])
    depth = torch.rand(count, generator=generator) * 0.6 + 0.7
    means = torch.from_numpy(camera.unproject(pixels.double().numpy(), depth.double().numpy())).float()
    splats = Splats(
        means,
        torch.randn(count, 4, generator=generator),
        torch.exp(torch.randn(count, 3, generator=generator) * 0.5) * footprint / focal,
        torch.sigmoid(torch.randn(count, generator=generator) * 1.5),
        torch.zeros(count, 3),
        torch.rand(count, channels, generator=generator),
    )
    return splats, camera


def draw_scene(splats: Splats, camera: Camera, **options: Any) -> Render:
    """`rasterize` of the semantics of a `random_scene`."""
    return rasterize(splats, splats.semantics, camera, **options)


def _rigid(axis: np.ndarray, angle: float, translation: list[float]) -> np.ndarray:
    """Rotation about a unit axis (Rodrigues), then a translation, float64 [4, 4]."""
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    matrix[:3, 3] = translation
    return matrix
