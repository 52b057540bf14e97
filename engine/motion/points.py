"""Points followed through the frames of a recording, by optical flow alone: what needs no reconstruction, and knows no depth."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from degense.engine.motion.flow import consistent, follow
from degense.engine.progress import Steps

PIXELS = 250_000  # frames are matched at about this size


def following_pixels(frame_of: Callable[[int], np.ndarray], count: int, queries: np.ndarray) -> Steps[tuple[np.ndarray, np.ndarray]]:
    """Where points are in each of `count` frames, float64 [K, T, 2] pixels, and whether they are seen, bool [K, T].

    From the frame of its query each point is followed forwards and backwards: steps are chained, a direct match of the two far frames
    starts where the chain ends, and each pixel keeps the one after which the frames look more alike (`engine.motion.follow`). A point
    counts as seen where the way there and back agrees.

    Parameters
    ----------
    frame_of : callable
        Gives a frame by its number, uint8 [H, W, 3].
    queries : float [K, 3]
        Frame, x and y of each point, pixels.
    """
    queries = np.asarray(queries, np.float64).reshape(-1, 3)
    starts = queries[:, 0].round().astype(int)
    height, width = frame_of(0).shape[:2]
    shrink = min(1.0, (PIXELS / (width * height)) ** 0.5)
    size = max(16, round(width * shrink)), max(16, round(height * shrink))
    scale = np.array(size) / (width, height)
    pixels = np.repeat(queries[:, None, 1:], count, axis=1)
    seen = np.ones((len(queries), count), bool)
    ways = [(start, frames) for start in np.unique(starts) for frames in (range(start, count), range(start, -1, -1)) if len(frames) > 1]
    total, done = sum(len(frames) - 1 for _, frames in ways), 0
    for start, frames in ways:
        points = np.flatnonzero(starts == start)
        at = queries[points, 1:] * scale
        small = (cv2.resize(frame_of(int(frame)), size, interpolation=cv2.INTER_AREA) for frame in frames)
        for frame, (out, back) in zip(frames[1:], follow(small), strict=True):
            yield done / total, "following points"
            done += 1
            pixels[points, frame] = (at + _at(out, at)) / scale
            seen[points, frame] = _at(consistent(out, back).astype(np.float32), at) > 0.5
    return pixels, seen


def _at(field: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A field [H, W] or [H, W, C] at pixel positions [n, 2], bilinear; beyond the frame as at its edge."""
    x, y = (places[None, :, axis].astype(np.float32) - np.float32(0.5) for axis in (0, 1))
    return cv2.remap(np.ascontiguousarray(field, np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
