"""Moves of a camera as pure functions from one `Camera` to the next, and the splat under a pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from degense.engine.camera import Camera


def orbit(camera: Camera, pivot: np.ndarray, yaw: float, pitch: float) -> Camera:
    """Turn around the world point `pivot` [3], which keeps its pixel; nearer things move right with `yaw`, down with `pitch`; radians."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]]) @ np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    viewmat = camera.viewmat.copy()
    centre = viewmat[:3, :3] @ pivot + viewmat[:3, 3]
    viewmat[:3, :3] = turn @ viewmat[:3, :3]
    viewmat[:3, 3] = turn @ (viewmat[:3, 3] - centre) + centre
    return replace(camera, viewmat=viewmat)


def pan(camera: Camera, pivot: np.ndarray, dx: float, dy: float) -> Camera:
    """Shift sideways so that `pivot` moves by (dx, dy) pixels."""
    depth = camera.viewmat[2, :3] @ pivot + camera.viewmat[2, 3]
    viewmat = camera.viewmat.copy()
    viewmat[0, 3] += dx * depth / camera.fx
    viewmat[1, 3] += dy * depth / camera.fy
    return replace(camera, viewmat=viewmat)


def dolly(camera: Camera, pivot: np.ndarray, factor: float) -> Camera:
    """Come closer (factor < 1) or back off (factor > 1): the pivot's depth is multiplied by `factor`."""
    viewmat = camera.viewmat.copy()
    depth = viewmat[2, :3] @ pivot + viewmat[2, 3]
    viewmat[2, 3] += depth * (factor - 1.0)
    return replace(camera, viewmat=viewmat)


def framing(means: np.ndarray, width: int, height: int) -> Camera:
    """A camera along +z that sees all points [N, 3]; a unit box around the origin when there are none."""
    low, high = (means.min(0), means.max(0)) if len(means) else (np.full(3, -0.5), np.full(3, 0.5))
    centre, radius = 0.5 * (low + high).astype(np.float64), max(0.5 * float(np.linalg.norm(high - low)), 1e-6)
    focal = 1.2 * max(width, height)
    viewmat = np.eye(4)
    viewmat[:3, 3] = -centre + [0.0, 0.0, radius * (1.0 + 2.0 * focal / min(width, height))]
    return Camera(width, height, focal, focal, width / 2, height / 2, viewmat)


def splat_at(x: float, y: float, camera: Camera, means: np.ndarray, quats: np.ndarray, scales: np.ndarray, opacities: np.ndarray) -> int:
    """Index of the splat that contributes most to the pixel position (x, y), −1 when none reaches an alpha of 1/255.

    Each splat's alpha is its opacity times the largest value of its 3D Gaussian along the pixel's ray; alphas are blended front to back.
    """
    from scipy.spatial.transform import Rotation

    near = (means @ camera.viewmat[2, :3] + camera.viewmat[2, 3]) > 0.0
    if not near.any():
        return -1
    eye = -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]
    ray = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0]) @ camera.viewmat[:3, :3]
    axes = Rotation.from_quat(quats[:, [1, 2, 3, 0]]).inv().as_matrix()
    spread = np.maximum(scales, 1e-9)
    origin = np.einsum("nij,nj->ni", axes, eye - means) / spread
    direction = (axes @ ray) / spread
    along = (origin * direction).sum(1)
    squared = (origin**2).sum(1) - along**2 / (direction**2).sum(1)
    alpha = np.where(near, opacities * np.exp(-0.5 * np.maximum(squared, 0.0)), 0.0)
    hit = np.flatnonzero(alpha >= 1 / 255)
    if not len(hit):
        return -1
    order = hit[np.argsort(means[hit] @ camera.viewmat[2, :3])]
    passed = np.cumprod(np.concatenate([[1.0], 1.0 - alpha[order][:-1]]))
    return int(order[np.argmax(alpha[order] * passed)])
