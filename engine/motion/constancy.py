"""Where tissue changes its look: there, optical flow matches what is not the same, and is no evidence of motion."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.motion.flow import Flow, Rgb, sample

DARK = 8.0  # grey levels added before the logarithm, so that noise in the dark is no change
FINE = 1.5  # pixels: σ of the blur before frames are compared, against noise and the flow's own error
LIGHT = 0.12  # of the width: σ above which a ratio is the light's, which travels with the endoscope
LARGEST_LIGHT = 0.15  # of a ratio that counts towards the change of light, so that a burn does not pass for it
LEAST, USUAL = 0.05, 2.0  # a change is larger than this and so many medians of the frame's, which noise and compression have,
SLACK = 0.7  # and than what so many pixels of error in the flow explain on this texture
REACH = 9  # pixels: side of the window in which a change spoils the matches, those of the search's own patches


def log_intensity(rgb: Rgb) -> np.ndarray:
    """Logarithm of a frame's colours, smoothed, float32 [H, W, 3]."""
    return cv2.GaussianBlur(np.log(rgb.astype(np.float32) + np.float32(DARK)), (0, 0), FINE)


def looks_changed(here: np.ndarray, there: np.ndarray, flow: Flow) -> np.ndarray:
    """Where a place looks different in the second frame, bool [H, W]; False where the flow leaves the frame.

        max_c | r_c(p) − r̄_c(p) | > `LEAST` + `USUAL` · median + `SLACK` · ‖∇‖,   r(p) = log I_here(p) − log I_there(p + f(p))

    in natural logarithms (0.1 is a tenth brighter), r̄ the smooth part of r, which is the change of light, and ‖∇‖ the slope of whichever
    frame is the smoother around p. Frames as `log_intensity` has them.
    """
    arrived = sample(there, flow)
    ratio = here - arrived
    known = np.isfinite(ratio[..., 0])
    if not known.any():
        return known
    ratio = np.where(known[..., None], ratio, 0) - np.median(ratio[known], axis=0)
    ratio -= _smooth(np.clip(ratio, -LARGEST_LIGHT, LARGEST_LIGHT), known)
    change = _largest(np.abs(ratio))
    slack = SLACK * np.minimum(_slope(here), _slope(np.where(known[..., None], arrived, here)))
    return known & (change > LEAST + USUAL * np.median(change[known]) + slack)


def _slope(frame: np.ndarray) -> np.ndarray:
    """The steepest slope of a frame [H, W, 3] around each pixel, a pixel, float32 [H, W]."""
    dx, dy = (cv2.Sobel(frame, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1)))
    return cv2.dilate(np.sqrt(_largest(dx**2 + dy**2)), np.ones((3, 3), np.uint8))


def _largest(values: np.ndarray) -> np.ndarray:
    """The largest of three channels [H, W, 3], float32 [H, W]: many times as fast as `np.max` along so short an axis."""
    return np.maximum(np.maximum(values[..., 0], values[..., 1]), values[..., 2])


def _smooth(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Gaussian mean of the known values [H, W, 3], computed on a grid of an eighth."""
    height, width = known.shape
    small = max(1, width // 8), max(1, height // 8)
    weight = known.astype(np.float32)
    stacked = np.dstack([values * weight[..., None], weight]).astype(np.float32)
    blurred = cv2.GaussianBlur(cv2.resize(stacked, small, interpolation=cv2.INTER_AREA), (0, 0), LIGHT * small[0])
    blurred = cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR)
    return blurred[..., :3] / np.maximum(blurred[..., 3:], 1e-3)


def around(mask: np.ndarray) -> np.ndarray:
    """A mask bool [H, W] grown by the window in which a change spoils the matches."""
    return cv2.dilate(mask.astype(np.uint8), np.ones((REACH, REACH), np.uint8)) > 0
