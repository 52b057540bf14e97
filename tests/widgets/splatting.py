"""An oracle: Gaussians splatted one after the other in float64, as the literature has it (EWA, dilated by 0.3 pixels squared)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from degense.engine.camera import Camera


def splatted(splats, camera: Camera, background=(0.0, 0.0, 0.0), dilation=0.3) -> np.ndarray:
    """float [H, W, 3] in [0, 1] of (means, quats, scales, opacities, colours)."""
    means, quats, scales, opacities, colours = splats
    turn = camera.viewmat[:3, :3]
    local = means @ turn.T + camera.viewmat[:3, 3]
    centres, depth = camera.project(means)
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    image = np.tile(np.asarray(background, float), (camera.height, camera.width, 1))
    for i in np.argsort(-depth):
        if depth[i] <= 0 or not np.isfinite(means[i]).all():
            continue
        spread = turn @ Rotation.from_quat(quats[i], scalar_first=True).as_matrix() @ np.diag(scales[i])
        jacobian = np.array(
            [
                [camera.fx / depth[i], 0, -camera.fx * local[i, 0] / depth[i] ** 2],
                [0, camera.fy / depth[i], -camera.fy * local[i, 1] / depth[i] ** 2],
            ]
        )
        flat = jacobian @ spread
        a, b, _, d = np.linalg.inv(flat @ flat.T + dilation * np.eye(2)).ravel()
        dx, dy = x - centres[i, 0], y - centres[i, 1]
        alpha = opacities[i] * np.exp(-0.5 * (a * dx * dx + 2 * b * dx * dy + d * dy * dy))
        alpha = np.where(alpha < 1 / 255, 0.0, alpha)[..., None]
        image = image * (1 - alpha) + alpha * colours[i]
    return image


def psnr(image: np.ndarray, truth: np.ndarray) -> float:
    """dB of uint8 pixels against floats in [0, 1]."""
    return float(-10 * np.log10(np.mean((image / 255.0 - truth) ** 2)))
