"""Windows of frames around points: brought back to what they showed in another frame, and compared with it."""

from __future__ import annotations

import cv2
import numpy as np

RADIUS, APART = 7, 2  # pixels: a window reaches so far to each side, and is looked up at places so far apart,
SPREAD = 4.2  # weighted by a Gaussian of this σ, pixels
ROUNDS = 5  # of Gauss-Newton
FLAT = 16.0  # squared grey levels a pixel²: texture as weak as this holds a window back from moving
FARTHEST = 2.0  # pixels that a window may move in one round

_steps = np.arange(-RADIUS, RADIUS + 1, APART, dtype=np.float32)
_x, _y = (offsets.ravel() for offsets in np.meshgrid(_steps, _steps))
_weights = np.exp(-(_x**2 + _y**2) / (2 * SPREAD**2))
_weights /= _weights.sum()
# Products with these are many times as fast as means over windows [K, n, 3] along so short an axis.
_half = np.tile(np.eye(3, dtype=np.float32) / np.float32(2 * len(_weights)), (len(_weights), 1))
_of_colours = np.repeat(_weights / np.float32(3), 3)


def windows_at(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """What an image uint8 or float32 [H, W] or [H, W, 3] shows around pixel positions [K, 2], float32 [K, n] or [K, n, 3].

    Bilinear; beyond the image as at its edge.
    """
    x, y = (np.asarray(places[:, axis, None], np.float32) - np.float32(0.5) for axis in (0, 1))
    return cv2.remap(image, x + _x, y + _y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float32)


def unlikeness(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Weighted mean absolute difference of windows [K, n, 3], float32 [K], grey levels; half of what all of a window has in common, a
    change of light, is not counted."""
    difference = a - b
    difference -= (difference.reshape(len(a), -1) @ _half)[:, None]
    return np.abs(difference, out=difference).reshape(len(a), -1) @ _of_colours


class Windows:
    """What `count` points look like in the frames from which they are followed."""

    def __init__(self, count: int):
        size = len(_weights)
        self._grey, self._dx, self._dy = (np.zeros((count, size), np.float32) for _ in range(3))
        self._inverse = np.zeros((count, 3), np.float32)
        self._colours = np.zeros((count, size, 3), np.float32)

    def keep(self, points: np.ndarray, grey: np.ndarray, colours: np.ndarray, places: np.ndarray) -> None:
        """Keep how points look at places [n, 2] of a frame: float32 [H, W] and uint8 [H, W, 3]."""
        slopes = [cv2.Sobel(grey, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1))]
        dx, dy = (values - (values @ _weights)[:, None] for values in (windows_at(slope, places) for slope in slopes))
        xx, yy, xy = (dx * dx) @ _weights + FLAT, (dy * dy) @ _weights + FLAT, (dx * dy) @ _weights
        self._inverse[points] = np.stack([yy, -xy, xx], 1) / (xx * yy - xy * xy)[:, None]
        self._dx[points], self._dy[points] = dx * _weights, dy * _weights
        self._grey[points], self._colours[points] = windows_at(grey, places), windows_at(colours, places)

    def matched(self, points: np.ndarray, grey: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Where a frame float32 [H, W] shows what is kept of points, near places [n, 2].

        Inverse compositional matching by translation (Baker & Matthews, IJCV 2004), damped where there is no texture; a change of light
        that a window has in common has no effect, because the weighted slopes of a window have no mean.
        """
        dx, dy, kept, inverse = self._dx[points], self._dy[points], self._grey[points], self._inverse[points]
        places = places.copy()
        for _ in range(ROUNDS):
            rest = windows_at(grey, places) - kept
            along_x, along_y = np.einsum("kn,kn->k", dx, rest), np.einsum("kn,kn->k", dy, rest)
            step = np.stack([inverse[:, 0] * along_x + inverse[:, 1] * along_y, inverse[:, 1] * along_x + inverse[:, 2] * along_y], 1)
            places -= np.clip(step, -FARTHEST, FARTHEST)
        return places

    def unlike(self, points: np.ndarray, colours: np.ndarray, places: np.ndarray) -> np.ndarray:
        """`unlikeness` of what a frame uint8 [H, W, 3] shows at places [n, 2] and what is kept of points, [n]."""
        return unlikeness(windows_at(colours, places), self._colours[points])
