"""The Gaussians that make the visible surface at a place: what is followed when a point or a region is followed."""

from __future__ import annotations

import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.scene.scene import Scene

#: Gaussians that a spot is followed by, and how far (pixels) their centres may lie from it.
FOLLOWED, REACH = 32, 12.0
#: How far (share of the depth) a Gaussian may lie from the visible surface and still be part of it.
THICKNESS = 0.1

#: Indices [k] and weights [k] (sum 1) of Gaussians. They keep their identity in time: following them follows the tissue, not the pixel.
Material = tuple[np.ndarray, np.ndarray]


def material_at(scene: Scene, frame: int, x: float, y: float) -> Material:
    """The Gaussians of the surface seen at a pixel position of a frame, weighed by opacity and nearness.

    DegenseError when nothing is reconstructed there.
    """
    pixels, depth, opacities, surface = _seen(scene, frame)
    distance = np.hypot(pixels[:, 0] - x, pixels[:, 1] - y)
    here = surface[int(y), int(x)]
    near = np.flatnonzero((distance < REACH) & (np.abs(depth - here) < THICKNESS * here))
    weights = opacities[near] * np.exp(-((distance[near] / (REACH / 3)) ** 2) / 2)
    best = np.argsort(weights)[-FOLLOWED:]
    return _normalised(near[best], weights[best])


def material_inside(scene: Scene, frame: int, inside: np.ndarray) -> Material:
    """The Gaussians of the surface seen in a region, bool [H, W], of a frame, weighed by opacity. Raises as `material_at` does."""
    pixels, depth, opacities, surface = _seen(scene, frame)
    height, width = inside.shape
    column, row = np.floor(pixels).astype(np.int64).T
    seen = (depth > 0) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    column, row = np.where(seen, column, 0), np.where(seen, row, 0)
    near = np.flatnonzero(seen & inside[row, column] & (np.abs(depth - surface[row, column]) < THICKNESS * depth))
    return _normalised(near, opacities[near])


def _seen(scene: Scene, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixel positions [N, 2], depths [N] and opacities [N] of all Gaussians, and the depth [H, W] of the surface, NaN where none is."""
    splats = scene.splats(frame)
    pixels, depth = scene.camera(frame).project(splats.means.cpu().numpy().astype(np.float64))
    return pixels, depth, splats.opacities.cpu().numpy().astype(np.float64), scene.render(frame, what=("depth",))["depth"]


def _normalised(indices: np.ndarray, weights: np.ndarray) -> Material:
    if weights.sum() < 1e-6:
        raise DegenseError("Nothing is reconstructed here; choose a place on tissue.")
    return indices, weights / weights.sum()
