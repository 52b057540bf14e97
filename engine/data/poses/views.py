"""The input of pose estimation: reduced frames, tissue without instruments, depth scaled to a median of 1."""

from __future__ import annotations

import cv2
import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.motion import confidence
from degense.engine.vocabulary import instruments

PIXELS = 40_000  # frames are matched at about this size; twice as many are no nearer the truth
EDGE = 7  # pixels around an invalid pixel or an instrument, whose motion bleeds into the tissue beside it
TEXTURE = 0.3  # `confidence` from which flow is more than a guess
CELL = 8  # pixels: at most one point in every cell of this side
HIGHLIGHT = 250  # of the brightest channel: from there on a pixel is taken for a reflection
SIDE = 32  # pixels: pictures smaller than this are too small for optical flow and its borders


class Views:
    """Reduced frames. Nothing is kept: every frame is read once or twice.

    Attributes
    ----------
    unit : float
        Lengths here = lengths of the clip × `unit`, chosen so that the median depth of frame `first` is 1 (1 where it has none).
    """

    def __init__(self, clip: Clip, first: int):
        self.clip, self.unit = clip, 1.0
        width, height = clip.size
        self.factor = min(1.0, (PIXELS / (width * height)) ** 0.5)
        self.camera: Camera = clip.cameras[0].scaled(self.factor)
        self._instruments = instruments(clip.classes)
        depth = self.depth(first)[self.tissue(first)]
        self.unit = 1 / float(np.median(depth[depth > 0])) if (depth > 0).any() else 1.0

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.camera.width, self.camera.height

    def picture(self, index: int) -> np.ndarray:
        """RGB, uint8 [h, w, 3]."""
        return cv2.resize(self.clip.frame(index), self.size, interpolation=cv2.INTER_AREA)

    def tissue(self, index: int) -> np.ndarray:
        """Valid pixels that no label map calls an instrument, away from the edges of both, bool [h, w]."""
        valid = self.clip.valid(index)
        if self._instruments and (labels := self.clip.labels(index)) is not None:
            valid = valid & ~np.isin(labels, self._instruments)
        small = cv2.resize(valid.astype(np.uint8), self.size, interpolation=cv2.INTER_NEAREST)
        return cv2.erode(small, np.ones((EDGE, EDGE), np.uint8), borderValue=1) > 0

    def depth(self, index: int) -> np.ndarray:
        """Camera depth z, float64 [h, w], 0 where unknown."""
        depth = cv2.resize(self.clip.depth(index), self.size, interpolation=cv2.INTER_NEAREST).astype(np.float64) * self.unit
        return np.where(np.isfinite(depth) & (depth > 0), depth, 0)

    def usable(self, index: int) -> np.ndarray:
        """Tissue whose texture pins its motion down, without reflections, which travel with the light; bool [h, w]."""
        return self._texture(index) > TEXTURE

    def points(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Usable points of known depth on a loose grid: rows and columns, int [n] each."""
        wanted = np.where(self.depth(index) > 0, self._texture(index), 0)
        height, width = wanted.shape
        rows, columns = height // CELL, width // CELL
        cells = wanted[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL).transpose(0, 2, 1, 3).reshape(rows * columns, -1)
        best = cells.argmax(axis=1)
        row, column = np.divmod(np.arange(rows * columns), columns)
        row, column = row * CELL + best // CELL, column * CELL + best % CELL
        chosen = cells.max(axis=1) > TEXTURE
        return row[chosen], column[chosen]

    def _texture(self, index: int) -> np.ndarray:
        picture = self.picture(index)
        return np.where(self.tissue(index) & (picture.max(axis=2) < HIGHLIGHT), confidence(picture), 0)
