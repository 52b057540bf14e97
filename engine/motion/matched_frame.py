"""A frame as points are followed through it: its octaves, and planes that windows are looked up in."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from degense.engine.motion.chain_kernel import FrameBlock
from degense.engine.motion.flow import even
from degense.engine.motion.landmarks import Landmarks, landmarks
from degense.engine.motion.lucas_kanade import Pyramid, Slopes
from degense.engine.motion.window_kernels import padded

SMOOTH = 0.8  # pixels: σ of the blur before windows are compared


class Planes(NamedTuple):
    """What one frame fills, float32: the octaves of its pyramid [1, h, w], its grey [1, H, W] and its colours [3, H, W], all padded."""

    octaves: Slopes
    grey: np.ndarray
    colours: np.ndarray


class MatchedFrame:
    """A frame at the size that is matched; `planes` are overwritten, new ones are made without."""

    def __init__(self, rgb: np.ndarray, size: tuple[int, int], planes: Planes | None = None):
        small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        blurred = cv2.GaussianBlur(small, (0, 0), SMOOTH)
        octaves, grey, colours = planes or (None, None, None)
        self.size, self.even = size, even(small)
        self.pyramid = Pyramid(self.even, octaves)
        self.grey, self.colours = padded(cv2.cvtColor(blurred, cv2.COLOR_RGB2GRAY), grey), padded(blurred, colours)

    @cached_property
    def landmarks(self) -> Landmarks:
        return landmarks(self.even)


class FrameRing:
    """Room for some frames that follow each other, used again in turn: new memory would take longer than to fill it."""

    def __init__(self, like: MatchedFrame, count: int):
        self.size, pyramid = like.size, like.pyramid

        def room(plane: np.ndarray) -> np.ndarray:
            return np.zeros((count, *plane.shape), np.float32)

        self._values, self._dx, self._dy = (
            tuple(room(plane[0]) for plane in planes) for planes in (pyramid.values, pyramid.dx, pyramid.dy)
        )
        self._grey, self._colours = room(like.grey), room(like.colours)
        self._count = count

    def planes(self, number: int) -> Planes:
        """The planes of the frame of a number, those of the frame `count` before it."""
        slot = number % self._count
        values, dx, dy = (tuple(plane[slot : slot + 1] for plane in planes) for planes in (self._values, self._dx, self._dy))
        return Planes((values, dx, dy), self._grey[slot], self._colours[slot])

    def block(self, numbers: list[int]) -> FrameBlock:
        """Frames of numbers that follow each other."""
        return FrameBlock(self._values, self._dx, self._dy, self._grey, self._colours, np.array(numbers) % self._count)
