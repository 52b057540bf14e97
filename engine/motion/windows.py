"""Windows of frames around points: brought back to what they showed in another frame, and compared with it."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.motion.window_kernels import compare, descend, look_up
from degense.engine.threads import run_kernel

RADIUS, APART = 7, 2  # pixels: a window reaches so far to each side, and is looked up at places so far apart,
SPREAD = 4.2  # weighted by a Gaussian of this σ, pixels
ROUNDS = 5  # of Gauss-Newton
FLAT = 16.0  # squared grey levels a pixel²: texture as weak as this holds a window back from moving
FARTHEST = 2.0  # pixels that a window may move in one round

_offsets = np.arange(-RADIUS, RADIUS + 1, APART)
_x, _y = (offsets.ravel() for offsets in np.meshgrid(_offsets, _offsets))
_weights = np.exp(-(_x**2 + _y**2) / np.float32(2 * SPREAD**2))
_weights /= _weights.sum()


def windows_at(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """What an image uint8 or float32 [H, W] or [H, W, 3] shows around pixel positions [K, 2], float32 [K, n] or [K, n, 3].

    Bilinear; beyond the image as at its edge.
    """
    channels = image if image.ndim == 3 else image[..., None]
    found = np.empty((len(places), len(_weights), channels.shape[2]), np.float32)
    run_kernel(look_up, channels, np.asarray(places, np.float64), _offsets, found)
    return found if image.ndim == 3 else found[..., 0]


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
        places = np.array(places, np.float64)
        kept = self._grey, self._dx, self._dy, self._inverse
        run_kernel(descend, grey[..., None], places, _offsets, np.asarray(points, np.int64), *kept, ROUNDS, FARTHEST)
        return places

    def unlike(self, points: np.ndarray, colours: np.ndarray, places: np.ndarray) -> np.ndarray:
        """How unlike what is kept of points a frame uint8 [H, W, 3] is at places [n, 2]: float32 [n], grey levels.

        The weighted mean absolute difference of windows; half of what all of a window has in common, a change of light, is not counted.
        """
        found = np.empty(len(places), np.float32)
        rows = np.asarray(points, np.int64)
        run_kernel(compare, colours, np.asarray(places, np.float64), _offsets, rows, self._colours, _weights, found)
        return found
