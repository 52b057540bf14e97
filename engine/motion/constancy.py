"""Where tissue changes its look: there, optical flow matches what is not the same, and is no evidence of motion."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numba import njit

import degense.engine.threads  # noqa: F401 - where compiled kernels are kept
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
    height, width = arrived.shape[:2]
    values, changed = np.empty((3, height * width), np.float32), np.zeros((height, width), np.bool_)
    count = _differences(here, arrived, values)
    if count == 0:
        return changed
    kept = np.empty((height, width, 4), np.float32)
    medians = np.array([_median(channel[:count]) for channel in values])
    _limited(here, arrived, medians, np.float32(LARGEST_LIGHT), kept)
    small = max(1, width // 8), max(1, height // 8)
    light = cv2.GaussianBlur(cv2.resize(kept, small, interpolation=cv2.INTER_AREA), (0, 0), LIGHT * small[0])
    change = _largest_change(here, arrived, medians, cv2.resize(light, (width, height), interpolation=cv2.INTER_LINEAR))
    usual = _median(change[np.isfinite(change)])
    _exceeding(here, arrived, change, np.float32(LEAST + USUAL * usual), np.float32(SLACK), changed)
    return changed


def _median(values: np.ndarray) -> np.float32:
    """Median of float32 [n]: several times as fast as `np.median`, which looks for three numbers at once."""
    half = len(values) // 2
    found = np.partition(values, half)
    return found[half] if len(values) % 2 else (found[:half].max() + found[half]) / np.float32(2)


@njit(nogil=True, cache=True, error_model="numpy")
def _differences(here, arrived, values):
    """Write the differences of two frames [H, W, 3] one after the other, where they are known, by channel; returns how many there are."""
    count = 0
    for i in range(here.shape[0]):
        for j in range(here.shape[1]):
            if np.isfinite(arrived[i, j, 0]):
                for c in range(3):
                    values[c, count] = here[i, j, c] - arrived[i, j, c]
                count += 1
    return count


@njit(nogil=True, cache=True, error_model="numpy")
def _limited(here, arrived, medians, limit, kept):
    """What of the ratio may be the change of light, beside 1 where it is known, float32 [H, W, 4]; 0 elsewhere."""
    for i in range(here.shape[0]):
        for j in range(here.shape[1]):
            known = np.isfinite(arrived[i, j, 0])
            kept[i, j, 3] = np.float32(known)
            for c in range(3):
                kept[i, j, c] = min(max(here[i, j, c] - arrived[i, j, c] - medians[c], -limit), limit) if known else np.float32(0)


@njit(nogil=True, cache=True, error_model="numpy")
def _largest_change(here, arrived, medians, light):
    """max_c | r_c − r̄_c |, float32 [H, W], NaN where it is not known; the smooth part of the ratio is `light` over its last channel."""
    change = np.full(here.shape[:2], np.nan, np.float32)
    for i in range(here.shape[0]):
        for j in range(here.shape[1]):
            if np.isfinite(arrived[i, j, 0]):
                weight, largest = max(light[i, j, 3], np.float32(1e-3)), np.float32(0)
                for c in range(3):
                    largest = max(largest, abs(here[i, j, c] - arrived[i, j, c] - medians[c] - light[i, j, c] / weight))
                change[i, j] = largest
    return change


@njit(nogil=True, cache=True, error_model="numpy")
def _exceeding(here, arrived, change, allowed, slack, changed):
    """Fill `changed`, False, where a change is above what is `allowed` and what `slack` pixels of the slope around explain."""
    height, width = change.shape
    for i in range(height):
        for j in range(width):
            if change[i, j] > allowed:  # few get so far
                steep_here, steep_there = np.float32(0), np.float32(0)
                for y in range(max(i - 1, 0), min(i + 2, height)):
                    for x in range(max(j - 1, 0), min(j + 2, width)):
                        steep_here = max(steep_here, _steepness(here, here, y, x))
                        steep_there = max(steep_there, _steepness(arrived, here, y, x))
                changed[i, j] = change[i, j] > allowed + slack * math.sqrt(min(steep_here, steep_there))


@njit(nogil=True, cache=True, error_model="numpy")
def _steepness(frame, other, y, x):
    """The square of the steepest slope of a frame [H, W, 3] at a pixel, a pixel, by Sobel's filter, mirrored at the edges; where the frame
    is not known it is as the `other`."""
    height, width, _ = frame.shape
    largest = np.float32(0)
    for c in range(3):
        dx, dy = np.float32(0), np.float32(0)
        for down in range(-1, 2):
            row = abs(y + down) if y + down < height else height - 2
            for right in range(-1, 2):
                column = abs(x + right) if x + right < width else width - 2
                value = frame[row, column, c] if np.isfinite(frame[row, column, 0]) else other[row, column, c]
                dx += np.float32(right * (2 - abs(down))) * value
                dy += np.float32(down * (2 - abs(right))) * value
        largest = max(largest, (dx * dx + dy * dy) / np.float32(64))
    return largest


def around(mask: np.ndarray) -> np.ndarray:
    """A mask bool [H, W] grown by the window in which a change spoils the matches."""
    return cv2.dilate(mask.astype(np.uint8), np.ones((REACH, REACH), np.uint8)) > 0
