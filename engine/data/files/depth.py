"""Depth maps beside a clip; for clips that bring none, a prior from how light falls off with distance, else flat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from degense.engine.camera import Camera
from degense.engine.data.files.images import checked, read_raw
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.numpy_files import open_npy
from degense.engine.errors import ClipError


class DepthFiles:
    """Depth maps stored one a frame, .npy or 8/16-bit pictures, their values times `scale`; 0 and what is not finite mean unknown."""

    def __init__(self, files: list[Path], size: tuple[int, int], scale: float = 1.0):
        self.files, self.size, self.scale = files, size, scale
        self.limits: tuple[float, float] | None = None  # depths are clipped to this range; see `robust_limits`

    def read(self, index: int) -> np.ndarray:
        """float32 [H, W], 0 where unknown. ClipError for a damaged file."""
        depth = read_depth(self.files[index], self.size) * np.float32(self.scale)
        return np.where(depth > 0, np.clip(depth, *self.limits), 0.0).astype(np.float32) if self.limits else depth

    def robust_limits(self, indices: Sequence[int]) -> tuple[float, float] | None:
        """3rd and 99.8th percentile of the known depths in some frames, as the peers clip EndoNeRF's stereo depth; None when none is known.

        One range for the whole clip: a range of each frame's own would make the clipped parts flicker.
        """
        known = [depth[depth > 0][::7] for depth in (read_depth(self.files[i], self.size) for i in indices)]
        values = np.concatenate(known) if known else np.zeros(0)
        return (float(np.percentile(values, 3)), float(np.percentile(values, 99.8))) if values.size else None


def read_depth(path: Path, size: tuple[int, int]) -> np.ndarray:
    """One depth map, float32 [H, W]; 0 where the file has 0, a negative value, NaN, infinity or what float32 cannot hold.

    ClipError for a wrong size or type.
    """
    if path.suffix.lower() == ".npy":
        raw = open_npy(path)
        raw = raw[..., 0] if raw.ndim == 3 and raw.shape[2] == 1 else raw
        if raw.shape != size[::-1]:
            raise ClipError(f"{shown(path)} has shape {list(raw.shape)}, but the frames are {size[0]} × {size[1]}, so they must agree.")
    else:
        raw = read_raw(path)
        if raw.ndim == 3:
            if (raw[..., 0] != raw[..., 1]).any() or (raw.shape[2] > 2 and (raw[..., 0] != raw[..., 2]).any()):
                raise ClipError(f"{shown(path)} is a colour picture, but depth needs one value a pixel.")
            raw = raw[..., 0]
        raw = checked(raw, path, size)
    with np.errstate(over="ignore", under="ignore"):  # float64 beyond float32 becomes infinite, which is unknown
        depth = np.array(raw, np.float32)
    depth[~(np.isfinite(depth) & (depth >= np.finfo(np.float32).tiny))] = 0.0  # the inverse of a subnormal number is infinite
    return depth


ALBEDO = 0.9  # share of the brightness predicted from colour that is attributed to albedo, not to distance
RIDGE = 0.15  # ridge regularisation: spread of log colour ratios below which they explain little
STRENGTH = 0.5  # factor on the remaining log depth, half of which is albedo too
GAMMA = 2.2  # of the display: back to linear light
REACH = 2.5  # the prior stays within this factor of its median depth
WORKING_WIDTH = 320  # the prior is smooth, so it is computed on small frames


@dataclass(frozen=True)
class Shading:
    """Depth cues of one frame, at most `WORKING_WIDTH` wide."""

    #: float32 [h, w]; (3 log cos a − log I) / 2, up to a constant: a wall at depth z that faces a light at the camera sends back I ∝ albedo
    #: · cos³a / z², a being the angle of the pixel's ray to the optical axis (cos²a: longer way, cos a: slanting light).
    log_depth: np.ndarray
    tint: np.ndarray  # float32 [h, w, 5]; colour without brightness: log R/G and log G/B, their squares and their product
    seen: np.ndarray  # bool [h, w]; pixels used: no highlights, and no colourless or dark pixels (instruments, shadows, the vignette)


def shading(rgb: np.ndarray, usable: np.ndarray, camera: Camera) -> Shading | None:
    """Depth cues from the shading of a frame uint8 [H, W, 3]; `usable` are pixels that show tissue, as far as known.

    None when less than 5 % of the usable pixels can be used, or their brightness varies by less than 3 %.
    """
    height, width = usable.shape
    factor = min(1.0, WORKING_WIDTH / width)
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255
    inside = cv2.resize(usable.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    high, low = small.max(axis=2), small.min(axis=2)
    light = high**GAMMA
    saturation = (high - low) / np.maximum(high, 1e-3)
    seen = inside & (high > 0.08)
    if not seen.any():
        return None
    seen &= (light > 0.1 * np.median(light[seen])) & (low < 0.75)
    if (typical := np.median(saturation[seen]) if seen.any() else 0.0) > 0.25:
        seen &= saturation > 0.4 * typical
    seen = cv2.erode(seen.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    if seen.sum() < max(1, 0.05 * inside.sum()):
        return None
    shade = np.log(np.maximum(light, 1e-4))
    if np.ptp(np.percentile(shade[seen], [5, 95])) < 0.03:
        return None
    xs = ((np.arange(size[0]) + 0.5) / factor - camera.cx) / camera.fx
    ys = ((np.arange(size[1]) + 0.5) / factor - camera.cy) / camera.fy
    log_cosine = -0.5 * np.log1p(xs[None, :] ** 2 + ys[:, None] ** 2)
    return Shading(((3 * log_cosine - shade) / 2).astype(np.float32), _tint(small), seen)


def _tint(rgb: np.ndarray) -> np.ndarray:
    logs = GAMMA * np.log(cv2.GaussianBlur(rgb, (0, 0), 2) + 0.004)
    red, blue = logs[..., 0] - logs[..., 1], logs[..., 1] - logs[..., 2]
    return np.stack([red, blue, red * red, blue * blue, red * blue], axis=-1)


def _spread(values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """`values` smoothed over the seen pixels and extrapolated to the others: fine near seen pixels, coarser elsewhere."""
    mean = float(values[seen].mean())
    result = np.full(values.shape, mean, np.float32)
    weight = seen.astype(np.float32)
    diagonal = float(np.hypot(*values.shape))
    for share in (0.3, 0.1, 0.03):
        sigma = share * diagonal
        near = cv2.GaussianBlur(weight, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
        blurred = cv2.GaussianBlur((values - mean) * weight, (0, 0), sigma, borderType=cv2.BORDER_REFLECT)
        confidence = np.clip(near / 0.3, 0, 1)
        result += confidence * (mean + blurred / np.maximum(near, 1e-6) - result)
    return result


class DepthPrior:
    """Relative depth, median 1, when none was measured: from light falloff, else flat.

    On synthetic surgeries with known depth the bare formula has a mean error of .29 in log depth, a flat guess .08: albedo is not even.
    The part of the brightness that colour predicts (by ridge regression) is therefore attributed to albedo, the rest is halved and
    smoothed, which brings the error to .06. The regression and the scale are fitted once for all frames, so depth does not jump when a
    tool enters. `frames`, uint8 [H, W, 3], are some of the clip, and `usable`, bool [H, W], their pixels that show tissue.
    """

    def __init__(self, frames: Sequence[np.ndarray], usable: Sequence[np.ndarray], camera: Camera):
        self.camera = camera
        readings = [r for r in (shading(frame, seen, camera) for frame, seen in zip(frames, usable, strict=True)) if r is not None]
        self.flat = not readings
        if self.flat:
            self.words = "flat, not metric: no depth files, and no shading to tell depth from; it only places the first splats"
            return
        #: For `provenance["depth"]`.
        self.words = "prior from light falloff, not metric: no depth files; brighter counts as nearer; it only places the first splats"
        tint = np.concatenate([r.tint[r.seen][::7] for r in readings])
        log_depth = np.concatenate([r.log_depth[r.seen][::7] for r in readings])
        self._tint_mean = tint.mean(axis=0)
        spread = tint - self._tint_mean
        # ridge: a tint that hardly varies is noise that happens to follow brightness, and must not explain it away
        normal = spread.T @ spread + len(tint) * RIDGE**2 * np.eye(tint.shape[1])
        self._tint_weights = ALBEDO * np.linalg.solve(normal, spread.T @ (log_depth - log_depth.mean()))
        self.level = float(np.median([np.median(self._log_depth(r)) for r in readings]))

    def _log_depth(self, reading: Shading) -> np.ndarray:
        return _spread((reading.log_depth - (reading.tint - self._tint_mean) @ self._tint_weights).astype(np.float32), reading.seen)

    def depth(self, rgb: np.ndarray, usable: np.ndarray, field: np.ndarray) -> np.ndarray:
        """Depth of one frame, float32 [H, W]; 0 outside `field` (bool [H, W]). A frame without shading is flat at 1."""
        reading = None if self.flat else shading(rgb, usable, self.camera)
        if reading is None:
            return field.astype(np.float32)
        log = STRENGTH * (self._log_depth(reading) - self.level)
        depth = np.exp(np.clip(log, -np.log(REACH), np.log(REACH)))
        full = cv2.resize(depth, field.shape[::-1], interpolation=cv2.INTER_LINEAR)
        return np.where(field, full, 0).astype(np.float32)
