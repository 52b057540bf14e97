"""Depth maps beside a clip."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from degense.engine.data.files.images import checked, read_raw
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.numpy_files import open_npy
from degense.engine.errors import ClipError


class DepthFiles:
    """Depth maps stored one a frame, .npy (as they are) or 8/16-bit pictures (raw values); 0 and what is not finite mean unknown.

    Parameters
    ----------
    size : (width, height)
    limits : (float, float), optional
        Depths are clipped to this range; see `robust_limits`.
    """

    def __init__(self, files: list[Path], size: tuple[int, int], limits: tuple[float, float] | None = None):
        self.files, self.size, self.limits = files, size, limits

    def read(self, index: int) -> np.ndarray:
        """float32 [H, W], 0 where unknown. ClipError for a damaged file."""
        depth = read_depth(self.files[index], self.size)
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
