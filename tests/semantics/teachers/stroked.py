"""A clip with scribbles whose every pixel's class is known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import UNLABELLED, Clip

COLOURS = np.array([[150, 60, 50], [205, 175, 90], [120, 125, 130]], np.float32)


class StrokedClip(Clip):
    """Tissue, a disc of other tissue on it that wanders to the right, and a bar that stands still; textured, noisy, labelled by strokes.

    Parameters
    ----------
    strokes : dict of frame to list of (class, (x, y), (x, y))
    contrast : float
        Of the disc's colour with the tissue's; at 0 nobody can tell them apart.
    """

    depth_measured = False

    def __init__(self, strokes, frames=10, width=128, height=96, seed=0, contrast=1.0):
        super().__init__("stroked", Path("stroked"), [Camera(width, height, 100, 100, width / 2, height / 2)] * frames)
        self.classes = ("liver", "gallbladder", "grasper", "fat")
        self.drawn, self.read = strokes, set()
        self.colours = COLOURS.copy()
        self.colours[1] = COLOURS[0] + contrast * (COLOURS[1] - COLOURS[0])
        random = np.random.default_rng(seed)
        self.texture = cv2.GaussianBlur(random.normal(0, 60, (height, width)).astype(np.float32), (0, 0), 2)
        self.noise = random.normal(0, 2, (frames, height, width, 3))

    def truth_labels(self, index):
        width, height = self.size
        y, x = np.mgrid[:height, :width]
        labels = np.zeros((height, width), np.uint8)
        labels[(x - 40 - 3 * index) ** 2 + (y - 56) ** 2 < 22**2] = 1
        labels[8:16, 20:110] = 2
        return labels

    def frame(self, index):
        self.read.add(index)
        labels = self.truth_labels(index)
        shift = np.roll(self.texture, 3 * index, axis=1)
        texture = np.where(labels == 1, shift, self.texture)
        return np.clip(self.colours[labels] + texture[..., None] + self.noise[index], 0, 255).astype(np.uint8)

    def valid(self, index):
        valid = np.ones(self.size[::-1], bool)
        valid[:, :4] = False
        return valid

    def depth(self, index):
        return np.zeros(self.size[::-1], np.float32)

    @property
    def stroked_frames(self):
        return sorted(self.drawn)

    def strokes(self, index):
        if index not in self.drawn:
            return None
        strokes = np.full(self.size[::-1], UNLABELLED, np.uint8)
        for value, start, end in self.drawn[index]:
            cv2.line(strokes, start, end, value, 2)
        return strokes


#: Two strokes on each of the three classes, on frame 0.
HONEST = {
    0: [
        (0, (100, 30), (115, 60)),
        (0, (10, 80), (20, 88)),
        (1, (32, 50), (44, 46)),
        (1, (36, 66), (46, 62)),
        (2, (28, 12), (48, 12)),
        (2, (90, 11), (104, 12)),
    ]
}
