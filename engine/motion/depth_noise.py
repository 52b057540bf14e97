"""How uncertain measured depth is from frame to frame, told by the clip itself."""

from __future__ import annotations

import cv2
import numpy as np

WINDOW = 7  # pixels: depth errs differently within it, while tissue moves alike


def depth_changes(before: np.ndarray, here: np.ndarray, after: np.ndarray, back: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """z(t−1) − 2 z(t) + z(t+1) along optical flow, less its mean around, float32 [h, w], NaN where a depth is unknown (0) or outside.

    `before`, `here` and `after` are measured depths [h, w] of three frames in a row, `back` and `forward` [h, w, 2] the flow, pixels, from
    the middle one to the others. Tissue that comes nearer ever faster does so together with what is around it, and is no error.
    """
    z = here, _at_the_end(before, back), _at_the_end(after, forward)
    known = np.logical_and.reduce([depth > 0 for depth in z])
    curved = np.where(known, z[1] - 2 * z[0] + z[2], 0).astype(np.float32)
    share, total = (cv2.blur(values, (WINDOW, WINDOW)) for values in (known.astype(np.float32), curved))
    return np.where(known, curved - total / np.maximum(share, 1e-6), np.nan)


def depth_error(changes: np.ndarray) -> float:
    """Standard deviation of one measured depth by `depth_changes` of any shape, in their unit; 0 where nothing is known.

    What is left of a second difference is the error of three measurements, √6 σ where they err independently. The median holds against the
    few places that do jump. Errors that are alike all over a window are not found.
    """
    known = np.abs(changes[np.isfinite(changes)])
    return float(1.4826 * np.median(known) / np.sqrt(6)) if known.size else 0.0


def _at_the_end(depth: np.ndarray, flow: np.ndarray) -> np.ndarray:
    """Depth at the end of a flow, between four known pixels; 0 elsewhere."""
    x, y = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in depth.shape[::-1]))
    end = x + flow[..., 0], y + flow[..., 1]
    known = cv2.remap((depth > 0).astype(np.float32), *end, cv2.INTER_LINEAR, borderValue=0)
    return np.where(known > 0.999, cv2.remap(depth, *end, cv2.INTER_LINEAR, borderValue=0), 0)
