"""Motion that the recording itself shows, from its reference frame on; how far the model moves, and how much of that contradicts it."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from torch import Tensor

from degense.engine.clip import Clip
from degense.engine.motion.flow import confidence, consistent, follow, sample


def displacement(means_t: Float[Tensor, "n 3"], means_ref: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """Distance of every Gaussian from its place at the reference time, ‖μᵢ(t) − μᵢ(ref)‖, scene units."""
    return torch.linalg.vector_norm(means_t - means_ref, dim=-1)


def spurious(
    model_flow: Float[np.ndarray, "height width 2"],
    observed_flow: Float[np.ndarray, "height width 2"],
    reliable: Bool[np.ndarray, "height width"],
    tolerance: float = 1.0,
) -> Float32[np.ndarray, "height width"]:
    """Model motion that the images contradict: max(0, ‖m(p) − o(p)‖ − tolerance), pixels.

    m is the model's motion projected into the image (`Scene.render`: `motion`), o the observed optical flow between the same two frames
    in the same direction. Where flow is not reliable (hidden, tools, out of the image) the result is NaN: not known,
    which is not the same as 0.

    What it cannot see: motion along the line of sight, which hardly moves pixels (at depth z, a change Δz shifts a pixel r away from
    the principal point by about r · Δz / z); errors below the tolerance, which should be the flow's own error; sliding along plain
    surfaces or straight edges, where flow itself is a guess (`engine.motion.confidence`); and motion that flow invents, for example of
    a highlight or where tissue chars. Missing motion counts like motion too many: both are a difference.

    Flows and tolerance are in pixels. The result is NaN also where either flow is not finite.
    """
    difference = np.linalg.norm(np.asarray(model_flow, np.float32) - np.asarray(observed_flow, np.float32), axis=-1)
    excess = np.maximum(difference - tolerance, 0)  # NaN stays NaN
    return np.where(reliable, excess, np.nan).astype(np.float32)


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
