"""The clip as the trainer sees it: reduced to a working size, in the normalised unit, read when needed."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.errors import ClipError
from degense.engine.latest import Latest
from degense.engine.profile import part

Item = TypeVar("Item")
CACHE_BYTES = 3 << 29
FARTHEST = 1e3  # times the median depth; what is farther, or nearer than its inverse, is a fault of the sensor and counts as unknown


@dataclass
class Frame:
    """One training frame on the training device."""

    image: Tensor  # uint8 [H, W, 3]
    valid: Tensor  # bool [H, W]
    #: float [H, W], normalised, 0 where unknown; unknown everywhere where depth was not measured: guesses serve as a start only, and take
    #: longer than all else.
    depth: Tensor


class TrainingFrames:
    """Frames, cameras and times of a clip at the working size."""

    def __init__(self, clip: Clip, max_pixels: int, device: torch.device):
        self.clip, self.device = clip, device
        width, height = clip.size
        self.scale = min(1.0, (max_pixels / (width * height)) ** 0.5)
        #: Normalised length = clip length × `unit`; chosen so that the median depth of the first training frame that shows any is 1.
        self.unit = 1.0 / _typical_depth(clip)
        #: At the working size, in the normalised unit.
        self.cameras: list[Camera] = [camera.scaled(self.scale).with_unit(self.unit) for camera in clip.cameras]
        pixels = self.cameras[0].width * self.cameras[0].height
        self._cache = Latest(max(2, CACHE_BYTES // (pixels * 8)))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the working frames."""
        return self.cameras[0].width, self.cameras[0].height

    def image(self, index: int) -> np.ndarray:
        """RGB uint8 at the working size."""
        with part("decode"):
            image = self.clip.frame(index)
        return image if self.scale == 1.0 else cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)

    def valid(self, index: int) -> np.ndarray:
        """bool at the working size: a reduced pixel is valid when every pixel under it is."""
        with part("decode"):
            valid = self.clip.valid(index)
        return valid if self.scale == 1.0 else cv2.resize(valid.astype(np.float32), self.size, interpolation=cv2.INTER_AREA) > 0.999

    def depth(self, index: int) -> np.ndarray:
        """float32 at the working size, normalised unit, 0 where unknown or absurd; nearest, since depths across an edge must not mix."""
        with part("decode"):
            depth = self.clip.depth(index)
        if self.scale != 1.0:
            depth = cv2.resize(depth, self.size, interpolation=cv2.INTER_NEAREST)
        depth = depth * np.float32(self.unit)
        depth[(depth < 1 / FARTHEST) | (depth > FARTHEST)] = 0.0
        return depth

    def __getitem__(self, index: int) -> Frame:
        return self._cache.get(index, lambda: self._made(index))

    def _made(self, index: int) -> Frame:
        image, valid = self.image(index), self.valid(index)
        depth = self.depth(index) if self.clip.depth_measured else np.zeros(valid.shape, np.float32)
        return Frame(*(torch.from_numpy(np.ascontiguousarray(array)).to(self.device) for array in (image, valid, depth)))


class FrameOrder:
    """Which training frame is drawn next: all of them in a new random order each round. Also the source of a trainer's other choices."""

    def __init__(self, frames: Sequence[int], seed: int):
        self.frames, self.random = list(frames), np.random.default_rng(seed)
        self.left: list[int] = []

    def next(self, wanted: Collection[int] = ()) -> int:
        """The next frame; the next one of `wanted`, if this round has any left."""
        if not self.left:
            self.left = self.random.permutation(self.frames).tolist()
        for position in range(len(self.left) - 1, -1, -1):
            if self.left[position] in wanted:
                return self.left.pop(position)
        return self.left.pop()

    def any_of(self, items: Sequence[Item]) -> Item:
        """One of the items, at random."""
        return items[int(self.random.integers(len(items)))]

    def state(self) -> dict[str, Any]:
        """For a checkpoint, as JSON values."""
        return {"order": list(self.left), "random": self.random.bit_generator.state}

    def restore(self, order: Sequence[int], random: Mapping[str, Any]) -> None:
        """Go back to what `state` returned."""
        self.left, self.random.bit_generator.state = list(order), random


def _typical_depth(clip: Clip) -> float:
    """Median depth of the first training frame that has a valid pixel with a depth, clip units. ClipError when none has."""
    for i in clip.train_frames:
        depth = clip.depth(i)[clip.valid(i)]
        known = depth[depth > 0]
        if known.size:
            return float(np.median(known))
    raise ClipError(
        f"{clip.path}: no training frame has a valid pixel with a depth, so there is nothing to start from; check the mask polarity"
    )
