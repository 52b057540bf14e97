"""A camera as JSON, as sessions and camera paths hold it."""

from __future__ import annotations

from typing import Any

import numpy as np

from degense.engine.camera import Camera

LARGEST_SIDE = 1 << 15


def camera_to_json(camera: Camera) -> dict[str, Any]:
    numbers = {name: float(getattr(camera, name)) for name in ("fx", "fy", "cx", "cy")}
    return {"width": camera.width, "height": camera.height, **numbers, "viewmat": camera.viewmat.tolist()}


def camera_from_json(data: dict[str, Any]) -> Camera:
    """The camera that `camera_to_json` wrote. ValueError, KeyError, TypeError or OverflowError for anything else."""
    viewmat = np.array(data["viewmat"], np.float64)
    fx, fy, cx, cy = (float(data[name]) for name in ("fx", "fy", "cx", "cy"))
    width, height = int(data["width"]), int(data["height"])
    if viewmat.shape != (4, 4) or not np.isfinite(viewmat).all() or not np.isfinite([fx, fy, cx, cy]).all() or min(fx, fy) <= 0:
        raise ValueError("not a camera")
    turn = viewmat[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0:
        raise ValueError("not the rotation of a camera")
    if not (0 < width < LARGEST_SIDE and 0 < height < LARGEST_SIDE):
        raise ValueError("not the size of a frame")
    return Camera(width, height, fx, fy, cx, cy, viewmat)
