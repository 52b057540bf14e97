"""From what a phantom's camera sees to what is recorded: noise, compression, stereo depth, and tracks of points."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.data.synthetic.scene import PhantomFrame, PhantomScene

TRACKED = 256  # points
HIDDEN = 0.8  # mm that a point may lie behind the surface that is seen in its pixel
BASELINE = 4.2  # mm between the eyes of a stereo endoscope
STEPS = 8  # of a pixel, in which disparity is matched
DISPARITY_NOISE = 0.25  # pixels at a width of 640


class Recorder:
    """A camera's noise (standard deviation, grey levels), and the quality of a JPEG compression, 100 for none."""

    def __init__(self, seed: int, noise: float, jpeg: int = 100):
        self.seed, self.noise, self.jpeg = seed, noise, jpeg

    def frame(self, rgb: np.ndarray, index: int) -> np.ndarray:
        """The recorded frame, uint8 [H, W, 3], of display values float [H, W, 3] in [0, 1]."""
        rng = np.random.default_rng([self.seed, index])
        image = np.clip(np.rint(rgb * 255 + self.noise * rng.standard_normal(rgb.shape)), 0, 255).astype(np.uint8)
        if self.jpeg >= 100:
            return image
        _, packed = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])
        return cv2.imdecode(packed, cv2.IMREAD_COLOR)[..., ::-1]

    def stereo_depth(self, depth: np.ndarray, image: np.ndarray, focal: float, index: int) -> np.ndarray:
        """Depth as a stereo endoscope measures it, float32 [H, W], mm, 0 where matching fails.

        Disparity d = f b / z has noise and steps, so the error grows with z². Near surfaces look a little larger than they are. Nothing is
        known behind their edges, in highlights, and in patches of plain tissue.
        """
        rng = np.random.default_rng([self.seed, index, 1])
        width = depth.shape[1]
        fat = max(1, round(width / 320))
        near = cv2.erode(depth, np.ones((2 * fat + 1, 2 * fat + 1), np.uint8))
        disparity = focal * BASELINE / np.maximum(near, 1e-3)
        wave = cv2.resize(rng.standard_normal((12, 16)).astype(np.float32), (width, len(depth)), interpolation=cv2.INTER_CUBIC)
        size = DISPARITY_NOISE * width / 640
        disparity = disparity + size * (0.7 * wave + 0.7 * rng.standard_normal(depth.shape))
        disparity = np.rint(disparity * STEPS * 640 / width) / (STEPS * 640 / width)
        edges = cv2.dilate((np.abs(depth - near) > 4).astype(np.uint8), np.ones((4 * fat + 1, 4 * fat + 1), np.uint8)) > 0
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
        spread = cv2.blur(grey**2, (9, 9)) - cv2.blur(grey, (9, 9)) ** 2
        plain = (spread < 2.0) & (wave > 0.3)
        unknown = edges | (grey > 250) | plain | (depth <= 0) | (disparity <= 0)
        return np.where(unknown, 0, focal * BASELINE / np.maximum(disparity, 1e-3)).astype(np.float32)


class PhantomTracks:
    """Points of the tissue, followed through the clip."""

    def __init__(self, scene: PhantomScene, seed: int):
        self._scene, self._places, self._visible = scene, list[np.ndarray](), list[np.ndarray]()
        rng = np.random.default_rng([seed, 3])
        everywhere = scene.points(0.0, np.arange(scene.vertices))
        pixels, _ = scene.camera(0.0).project(everywhere)
        inside = np.flatnonzero(np.all((pixels > 0) & (pixels < (scene.width, scene.height)), axis=1))
        self._vertices = np.sort(rng.choice(inside, min(TRACKED, len(inside)), replace=False))

    def add(self, s: float, view: PhantomFrame) -> None:
        """The next frame, at clip time s."""
        places = self._scene.points(s, self._vertices)
        pixels, z = self._scene.camera(s).project(places)
        column, row = np.floor(pixels).astype(int).T
        height, width = view.depth.shape
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
        tissue = np.isfinite(view.displacement[row, column, 0])
        self._places.append(places.astype(np.float32))
        self._visible.append(inside & tissue & (z <= view.depth[row, column] + HIDDEN))

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Places, float32 [K, T, 3], mm, world axes; and where they are seen, bool [K, T]."""
        return np.stack(self._places, 1), np.stack(self._visible, 1)


def psnr(image: np.ndarray, rgb: np.ndarray) -> float:
    """Of a recorded frame against what a perfect reconstruction shows, rounded to 8 bits, dB: no reconstruction scores more."""
    error = image.astype(np.float64) - np.rint(np.clip(rgb, 0, 1) * 255)
    return float(10 * np.log10(255**2 / max(np.mean(error**2), 1e-6)))
