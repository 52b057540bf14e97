"""Small stand-ins that several test folders share."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import UNLABELLED, Clip


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


class MovingWall(Clip):
    """A plane that faces a camera standing still and moves as a whole, with smooth texture. Everything about it is exact.

    Parameters
    ----------
    velocity : (float, float, float)
        Per frame, in the clip's unit; the wall is at depth 3 at frame 0. At that depth a unit is `focal` / 3 pixels.
    measured : bool
    hole : (slice, slice) or None
        Pixels that are never valid.
    labelled : sequence of int
        Frames with a label map: class 1 right of the middle of the wall (it moves along), class 0 left of it, the top two rows unlabelled.
    seed : int
        Of the texture.
    """

    def __init__(
        self,
        frames: int = 5,
        width: int = 96,
        height: int = 72,
        velocity: tuple[float, float, float] = (0.06, 0.03, 0.0),
        *,
        measured: bool = True,
        hole: tuple[slice, slice] | None = None,
        labelled: Sequence[int] = (),
        seed: int = 0,
    ):
        camera = Camera(width, height, float(width), float(width), width / 2, height / 2)
        super().__init__(
            name="wall",
            path=Path(f"/nowhere/wall-{frames}-{width}x{height}-{velocity}-{seed}"),
            cameras=[camera] * frames,
            classes=("liver", "gallbladder") if labelled else (),
            provenance={"depth": "exact"},
        )
        random = np.random.default_rng(seed)
        self.velocity, self.measured, self.hole, self._labelled = np.array(velocity), measured, hole, list(labelled)
        angle, length = random.uniform(0, 2 * np.pi, 24), random.uniform(0.25, 0.8, 24)  # wavelengths of 8 to 26 pixels
        self._waves = 2 * np.pi / length[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
        self._phases, self._strengths = random.uniform(0, 2 * np.pi, (24, 3)), random.uniform(5, 15, (24, 3))

    def material(self, index: int) -> np.ndarray:
        """Where the points that the pixels of a frame show lay on the wall at frame 0, float64 [H, W, 2]."""
        width, height = self.size
        pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)
        seen = self.cameras[index].unproject(pixels, np.full((height, width), 3 + index * self.velocity[2]))
        return seen[..., :2] - index * self.velocity[:2]

    def flow(self, here: int, there: int) -> np.ndarray:
        """Exact optical flow, float64 [H, W, 2], pixels."""
        points = np.concatenate([self.material(here), np.full((*self.size[::-1], 1), 3.0)], -1)
        places = [self.cameras[i].project(points + i * self.velocity)[0] for i in (here, there)]
        return places[1] - places[0]

    def frame(self, index: int) -> np.ndarray:
        waves = np.sin((self.material(index) @ self._waves.T)[..., None] + self._phases)
        return np.clip(128 + (waves * self._strengths).sum(2), 0, 255).astype(np.uint8)

    def valid(self, index: int) -> np.ndarray:
        valid = np.ones(self.size[::-1], bool)
        if self.hole is not None:
            valid[self.hole] = False
        return valid

    def depth(self, index: int) -> np.ndarray:
        return np.full(self.size[::-1], 3 + index * self.velocity[2], np.float32)

    @property
    def depth_measured(self) -> bool:
        return self.measured

    @property
    def labelled_frames(self) -> list[int]:
        return self._labelled

    def labels(self, index: int) -> np.ndarray | None:
        if index not in self._labelled:
            return None
        labels = (self.material(index)[..., 0] > 0).astype(np.uint8)
        labels[:2] = UNLABELLED
        return labels


def ply_columns(path: Path) -> np.ndarray:
    """Numbers of a binary PLY whose properties are all float, float32 [N, properties]."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    assert header.startswith(b"ply\nformat binary_little_endian 1.0\n")
    return np.frombuffer(body, "<f4").reshape(-1, header.count(b"property float ")).copy()


class CharringWall(MovingWall):
    """A wall that stands still while a soft spot of it darkens and grows."""

    def frame(self, index):
        height, width = self.size[::-1]
        y, x = np.mgrid[:height, :width]
        away = np.hypot(x - width / 2, y - height / 2) / (0.05 * width * (1 + index))
        return np.clip(super().frame(index) * (1 - 0.8 * np.exp(-(away**2) / 2))[..., None], 0, 255).astype(np.uint8)
