"""The Gaussians that make the visible surface at a place: what is followed when a point or a region is followed."""

from __future__ import annotations

import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.scene.nearest import nearest
from degense.engine.scene.scene import Scene

#: Gaussians that a spot is followed by, and how far (pixels) their centres may lie from it.
FOLLOWED, REACH = 32, 12.0
LOOKED_AT, FAINT = 128, 0.01  # nearest Gaussians that these are chosen from, of more than this opacity
#: How far (share of the depth) a Gaussian may lie from the visible surface and still be part of it.
THICKNESS = 0.1

#: Indices [k] and weights [k] (sum 1) of Gaussians. They keep their identity in time: following them follows the tissue, not the pixel.
Material = tuple[np.ndarray, np.ndarray]


def material_at(scene: Scene, frame: int, x: float, y: float) -> Material:
    """The Gaussians of the surface seen at a pixel position of a frame, weighed by opacity and nearness.

    DegenseError when nothing is reconstructed there.
    """
    rows, weights, _ = materials_at(scene, frame, np.array([[x, y]]))
    used = weights[0] > 0
    return _normalised(rows[0, used], weights[0, used])


def materials_at(scene: Scene, frame: int, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices [K, n], weights [K, n] (sum 1, or 0 where nothing is reconstructed) and depth [K], as `material_at`, at pixels [K, 2]."""
    height, width = scene.camera(frame).height, scene.camera(frame).width
    inside = np.all((pixels >= 0) & (pixels < (width, height)), axis=1)
    column, row = np.where(inside[:, None], pixels, 0).astype(np.int64).T
    positions, depth, opacities, surface = _seen(scene, frame)
    here = np.where(inside, surface[row, column], np.nan)
    shown = np.flatnonzero((depth > 0) & (opacities > FAINT) & np.isfinite(positions).all(1))
    if not len(shown):
        return np.zeros((len(pixels), 1), int), np.zeros((len(pixels), 1)), here
    found, distance = nearest(positions[shown], np.where(inside[:, None], pixels, 0), LOOKED_AT)
    rows = shown[found]
    with np.errstate(invalid="ignore"):
        near = (distance <= REACH) & (np.abs(depth[rows] - here[:, None]) < THICKNESS * here[:, None])
    weights = np.where(near, opacities[rows] * np.exp(-((np.where(near, distance, 0) / (REACH / 3)) ** 2) / 2), 0)
    best = np.argsort(weights, axis=1)[:, -FOLLOWED:]
    rows, weights = np.take_along_axis(rows, best, 1), np.take_along_axis(weights, best, 1)
    total = weights.sum(1, keepdims=True)
    return rows, np.where(total > 1e-6, weights / np.maximum(total, 1e-6), 0), here


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
