"""Small stand-ins that several test folders share."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from engine.camera import Camera
from engine.clip import UNLABELLED, Clip


class MemoryClip(Clip):
    """A clip held in memory: a textured wall at depth 2 in front of which a square slides to the right; two classes."""

    def __init__(self, frames: int = 10, width: int = 48, height: int = 40, *, labels: bool = True, measured: bool = True, seed: int = 0):
        camera = Camera(width, height, 1.1 * width, 1.1 * width, width / 2, height / 2)
        super().__init__(
            name="memory",
            path=Path(f"/nowhere/memory-{frames}-{width}x{height}-{seed}"),
            cameras=[camera] * frames,
            classes=("liver", "gallbladder") if labels else (),
            provenance={"depth": "exact"},
        )
        random = np.random.default_rng(seed)
        coarse = random.uniform(60, 200, (height // 8 + 2, width // 8 + 2, 3))
        rows, columns = np.arange(height) // 8, np.arange(width) // 8
        self.wall = coarse[rows][:, columns].astype(np.uint8)
        self.measured, self.labelled = measured, labels

    def place(self, index: int) -> tuple[slice, slice]:
        left = 6 + index
        return slice(12, 24), slice(left, left + 12)

    @property
    def labelled_frames(self) -> list[int]:
        return list(range(len(self))) if self.labelled else []

    def frame(self, index: int) -> np.ndarray:
        image = self.wall.copy()
        image[self.place(index)] = (220, 40, 30)
        return image

    def valid(self, index: int) -> np.ndarray:
        valid = np.ones(self.wall.shape[:2], bool)
        valid[:2] = False
        return valid

    def depth(self, index: int) -> np.ndarray:
        depth = np.full(self.wall.shape[:2], 2.0, np.float32)
        depth[self.place(index)] = 1.8
        return depth

    @property
    def depth_measured(self) -> bool:
        return self.measured

    def labels(self, index: int) -> np.ndarray | None:
        if not self.labelled:
            return None
        labels = np.zeros(self.wall.shape[:2], np.uint8)
        labels[self.place(index)] = 1
        labels[-2:] = UNLABELLED
        return labels
