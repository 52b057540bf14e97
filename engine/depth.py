"""Depth for clips that bring none: from how light falls off with distance, else flat. Depth from files is read by `engine.readers`."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from engine.camera import Camera

REACH = 2.5  # the prior stays within this factor of its median depth: beyond it, albedo speaks, not distance
WORKING_WIDTH = 320  # the prior is smooth, so it is computed on small frames


def light_falloff(rgb: np.ndarray, usable: np.ndarray, camera: Camera) -> np.ndarray | None:
    """Log depth up to a constant from one frame, for a light that sits at the camera.

    A wall at depth z that faces the camera sends back I ∝ cos³a / z², a being the angle of the pixel's ray to the optical axis: cos²a from
    the longer way, cos a from the slanting light. So log z = (3 log cos a − log I) / 2. Highlights, colourless and dark pixels
    (instruments, shadows, the vignette) are no witnesses; they take the depth of what surrounds them. The result is smooth, because albedo
    changes at edges and distance mostly does not.

    Parameters
    ----------
    rgb : uint8 [H, W, 3]
    usable : bool [H, W]
        Pixels that show tissue, as far as known.
    camera : Camera

    Returns
    -------
    float32 [h, w] or None
        At most `WORKING_WIDTH` wide; None when less than 5 % of the usable pixels are witnesses, or their brightness varies by less than
        3 %: such a frame has no shading.
    """
    height, width = usable.shape
    factor = min(1.0, WORKING_WIDTH / width)
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    inside = cv2.resize(usable.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    if not inside.any():
        return None
    high, low = small.max(axis=2), small.min(axis=2)
    light = high**2.2  # back from the display's gamma to linear light
    saturation = (high - low) / np.maximum(high, 1e-3)
    seen = inside & (high > 0.08)
    if not seen.any():
        return None
    seen &= (light > 0.1 * np.median(light[seen])) & (low < 0.75)
    if (tint := np.median(saturation[seen]) if seen.any() else 0.0) > 0.25:
        seen &= saturation > 0.4 * tint
    seen = cv2.erode(seen.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    if seen.sum() < 0.05 * inside.sum():
        return None
    shade = np.log(np.maximum(light, 1e-4))
    if np.ptp(np.percentile(shade[seen], [5, 95])) < 0.03:
        return None
    xs = (np.arange(size[0]) + 0.5) / factor - camera.cx
    ys = (np.arange(size[1]) + 0.5) / factor - camera.cy
    tangent2 = (xs / camera.fx)[None, :] ** 2 + (ys / camera.fy)[:, None] ** 2
    log_cosine = -0.5 * np.log1p(tangent2)
    return _spread((3 * log_cosine - shade).astype(np.float32) / 2, seen)


def _spread(values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """`values` smoothed over the seen pixels and carried into the others: fine where there are witnesses near by, coarser where not."""
    mean = float(values[seen].mean())
    result = np.full(values.shape, mean, np.float32)
    weight = seen.astype(np.float32)
    diagonal = float(np.hypot(*values.shape))
    for share in (0.3, 0.1, 0.03):
        sigma = share * diagonal
        near = cv2.GaussianBlur(weight, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
        blurred = cv2.GaussianBlur((values - mean) * weight, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
        trust = np.clip(near / 0.3, 0, 1)
        result += trust * (mean + blurred / np.maximum(near, 1e-6) - result)
    return result


class DepthPrior:
    """Relative depth, median 1, when nothing was measured: from light falloff, else flat.

    One constant scales all frames, so depth does not jump when a tool enters or the scene comes nearer.

    Parameters
    ----------
    frames : list of uint8 [H, W, 3]
        Some frames of the clip.
    usable : list of bool [H, W]
        Their pixels that show tissue.
    camera : Camera

    Attributes
    ----------
    words : str
        For `provenance["depth"]`.
    """

    def __init__(self, frames: Sequence[np.ndarray], usable: Sequence[np.ndarray], camera: Camera):
        self.camera = camera
        levels = [
            float(np.median(log)) for log in (light_falloff(f, u, camera) for f, u in zip(frames, usable, strict=True)) if log is not None
        ]
        self.level: float | None = float(np.median(levels)) if levels else None
        if self.level is None:
            self.words = "flat, not metric: no depth files, and no shading to tell depth from; it only places the first splats"
        else:
            self.words = "prior from light falloff, not metric: no depth files; brighter counts as nearer; it only places the first splats"

    def depth(self, rgb: np.ndarray, usable: np.ndarray, field: np.ndarray) -> np.ndarray:
        """Depth of one frame, float32 [H, W]; 0 outside `field` (bool [H, W]). A frame without shading is flat at 1."""
        log = None if self.level is None else light_falloff(rgb, usable, self.camera)
        if log is None or self.level is None:
            return field.astype(np.float32)
        depth = np.exp(np.clip(log - self.level, -np.log(REACH), np.log(REACH)))
        full = cv2.resize(depth, field.shape[::-1], interpolation=cv2.INTER_LINEAR)
        return np.where(field, full, 0).astype(np.float32)
