"""Windows of frames around points: brought back to what they showed in another frame, and compared with it."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.motion.chain_kernel import FrameBlock, follow_through
from degense.engine.motion.window_kernels import APART, LANES, REACH, ROWS, SAMPLES, compare, descend, look_up
from degense.engine.threads import run_kernel

SPREAD = 4.2  # pixels: σ of the Gaussian that samples are weighted by
ROUNDS = 5  # of Gauss-Newton
FLAT = 16.0  # squared grey levels a pixel²: texture as weak as this holds a window back from moving
FARTHEST = 2.0  # pixels that a window may move in one round

_x, _y = np.meshgrid(np.arange(LANES) - REACH, np.arange(ROWS) * APART - REACH)
_share = ((_x <= REACH) & (_x % APART == REACH % APART)).ravel().astype(np.float32)  # one column in `APART` counts, as one row does
_share /= _share.sum()
_weights = np.exp(-(_x**2 + _y**2) / (2 * SPREAD**2)).ravel().astype(np.float32) * _share
_weights /= _weights.sum()


def windows_at(planes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """What planes (`padded`) show around pixel positions [K, 2], float32 [K, C, SAMPLES]. Bilinear."""
    found = np.empty((len(places), len(planes), SAMPLES), np.float32)
    run_kernel(look_up, planes, np.asarray(places, np.float64), found)
    return found


class Windows:
    """What `count` points look like in the frames from which they are followed.

    Frames are planes (`padded`): one of grey, three of colours.
    """

    def __init__(self, count: int):
        self._grey, self._dx, self._dy = (np.zeros((count, SAMPLES), np.float32) for _ in range(3))
        self._inverse = np.zeros((count, 3), np.float32)
        self._colours = np.zeros((count, 3, SAMPLES), np.float32)

    def keep(self, points: np.ndarray, grey: np.ndarray, colours: np.ndarray, places: np.ndarray) -> None:
        """Keep how points look at places [n, 2] of a frame."""
        slopes = np.stack([cv2.Sobel(grey[0], cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1))])
        dx, dy = (values - (values @ _weights)[:, None] for values in windows_at(slopes, places).swapaxes(0, 1))
        xx, yy, xy = (dx * dx) @ _weights + FLAT, (dy * dy) @ _weights + FLAT, (dx * dy) @ _weights
        self._inverse[points] = np.stack([yy, -xy, xx], 1) / (xx * yy - xy * xy)[:, None]
        self._dx[points], self._dy[points] = dx * _weights, dy * _weights
        self._grey[points], self._colours[points] = windows_at(grey, places)[:, 0], windows_at(colours, places)

    def matched(self, points: np.ndarray, grey: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Where a frame shows what is kept of points, near places [n, 2].

        Inverse compositional matching by translation (Baker & Matthews, IJCV 2004), damped where there is no texture; a change of light
        that a window has in common has no effect, because the weighted slopes of a window have no mean.
        """
        places = np.array(places, np.float64)
        kept = self._grey, self._dx, self._dy, self._inverse
        run_kernel(descend, grey, places, np.asarray(points, np.int64), *kept, ROUNDS, FARTHEST)
        return places

    def unlike(self, points: np.ndarray, frames: np.ndarray, numbers: np.ndarray, places: np.ndarray) -> np.ndarray:
        """How unlike what is kept of points frames of `numbers` [B] among colours [S, 3, H, W] are at places [n, B, 2]: float32 [n, B],
        grey levels; NaN where a place is.

        The weighted mean absolute difference of windows; half of what all of a window has in common, a change of light, is not counted.
        """
        found = np.empty(places.shape[:2], np.float32)
        places, rows = np.asarray(places, np.float64), np.asarray(points, np.int64)
        run_kernel(compare, frames, numbers, places, rows, self._colours, _share, _weights, found)
        return found

    def follow(
        self, points: np.ndarray, frames: FrameBlock, places: np.ndarray, limits: tuple[float, float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Where frames show points that the first of them shows at `places` [n, 2], float64 [n, B, 2], and how unlike them they look there,
        float32 [n, B]; NaN from where a point is lost (`follow_through`)."""
        found = np.full((len(places), len(frames.numbers), 2), np.nan)
        unlike = np.full(found.shape[:2], np.nan, np.float32)
        found[:, 0] = places
        kept = self._grey, self._dx, self._dy, self._inverse, self._colours
        run_kernel(
            follow_through, *frames, np.asarray(points, np.int64), kept, (_share, _weights), (ROUNDS, FARTHEST), limits, found, unlike
        )
        return found, unlike
