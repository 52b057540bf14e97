"""Frames that are cropped or resampled after they are read: one view of a stereo video, or a picture without its lens distortion."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np


class Frames(Protocol):
    """What holds the frames as they were stored."""

    files: list

    def __len__(self) -> int: ...

    def read(self, index: int) -> np.ndarray:
        """RGB, uint8 [H, W, 3]."""


class RemappedFrames:
    """The part `crop` (rows, columns) of stored frames, looked up at `places`; black outside.

    `places` are pixels (x, y) of that part, float32 [H, W, 2], whose middles are whole numbers, as OpenCV has them.
    """

    def __init__(self, stored: Frames, crop: tuple[slice, slice], places: np.ndarray):
        self.files, self.size = stored.files, (places.shape[1], places.shape[0])
        self._stored, self._crop, self._places = stored, crop, places

    def __len__(self) -> int:
        return len(self._stored)

    def read(self, index: int) -> np.ndarray:
        """RGB, uint8 [H, W, 3]."""
        frame = np.ascontiguousarray(self._stored.read(index)[self._crop])
        return cv2.remap(frame, self._places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
