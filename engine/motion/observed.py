"""Motion that the recording itself shows, from its reference frame on."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from degense.engine.clip import Clip
from degense.engine.motion.flow import confidence, consistent, follow, sample

PIXELS = 80_000  # flow is measured at about this size: a frame of it takes 0.4 MB, and a tenth of a second
TEXTURE = 0.3  # `confidence` below which flow is a guess


class ObservedMotion:
    """Optical flow of every frame to the reference frame, followed from frame to frame; measured as far as it is asked for, then kept.

    Frames before the reference have no motion to show.
    """

    def __init__(self, clip: Clip, reference: int):
        self.clip, self.reference = clip, reference
        width, height = clip.size
        shrink = min(1.0, (PIXELS / (width * height)) ** 0.5)
        self.size = max(12, round(width * shrink)), max(12, round(height * shrink))
        self._start = self._frame(reference), self._valid(reference)
        no_motion = np.zeros((self.size[1], self.size[0], 2), np.float16)
        self._measured: list[tuple[np.ndarray, np.ndarray]] = [(no_motion, self._start[1])]
        self._followed: Iterator[tuple[np.ndarray, np.ndarray]] = follow(self._frame(i) for i in range(reference, len(clip)))

    def at(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Flow of `frame` to the reference, float32 [H, W, 2] in pixels, and where it is reliable, bool [H, W].

        Reliable: consistent forwards and backwards, valid at both ends, on texture that pins motion down.
        """
        while len(self._measured) <= frame - self.reference:
            here = self.reference + len(self._measured)
            out, back = next(self._followed)
            arrives = sample(self._start[1].astype(np.float32), back) > 0.99
            sure = self._valid(here) & arrives & consistent(back, out) & (confidence(self._frame(here)) > TEXTURE)
            self._measured.append((back.astype(np.float16), sure))
        flow, sure = self._measured[max(0, frame - self.reference)]
        width, height = self.clip.size
        scale = np.array([width / self.size[0], height / self.size[1]], np.float32)
        large = cv2.resize(flow.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) * scale
        known = cv2.resize(sure.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
        return large, known & (frame >= self.reference)

    def _frame(self, index: int) -> np.ndarray:
        return cv2.resize(self.clip.frame(index), self.size, interpolation=cv2.INTER_AREA)

    def _valid(self, index: int) -> np.ndarray:
        return cv2.resize(self.clip.valid(index).astype(np.uint8), self.size, interpolation=cv2.INTER_NEAREST) > 0
