"""Motion that the recording itself shows, from its reference frame on; how far the model moves, and how much of that contradicts it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from degense.engine.clip import Clip
from degense.engine.motion.constancy import around, log_intensity, looks_changed
from degense.engine.motion.flow import confidence, consistent, flow_error, follow, normalized, sample
from degense.engine.motion.surroundings import Shares, from_around


def displacement(means_t: Float[Tensor, "n 3"], means_ref: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """Distance of every Gaussian from its place at the reference time, ‖μᵢ(t) − μᵢ(ref)‖, scene units."""
    return torch.linalg.vector_norm(means_t - means_ref, dim=-1)


PRIOR = 1.0  # pixels that a model is expected to be off by in either direction where the recording shows nothing (decision 66)
EXPLAINED = 2.0  # spreads of the motion around that a place may be from its mean before the model is believed to be wrong
LEAST = 0.1  # pixels: error that any flow has
PIXELS = 80_000  # flow is measured at about this size: a frame of it takes 0.4 MB, and a tenth of a second
SMOOTHNESS = 40.0  # of that flow (`follow`): what judges a model needs to be right in many places rather than at each edge
TEXTURE = 0.3  # `confidence` below which flow is a guess


class Observed(NamedTuple):
    """How the pixels of a frame went to the reference frame."""

    #: float32 [H, W, 2]; pixels; where motion is not seen, a place's share of what goes on there of the motion seen around (`from_around`,
    #: `Shares`), or the mean of that and of flow on plain tissue.
    flow: np.ndarray
    #: bool [H, W]; flow is consistent forwards and backwards, valid at both ends, on texture that pins motion down, and the place looks as
    #: it did.
    seen: np.ndarray
    #: float32 [H, W]; pixels: 0 where motion is seen; else how far that may be from what is seen around, less where a place kept nearer to
    #: its share of that before, or flow on plain tissue tells more; NaN where nothing is seen, nor the frame valid.
    spread: np.ndarray


def contradicted(modelled: Float[np.ndarray, "height width 2"], observed: Observed) -> Float32[np.ndarray, "height width"]:
    """How far the model's motion is expected to be from the true one, by what the recording shows of that; pixels:

        √((g d)² + (1 − g) P²),    g = E² / (E² + spread²),    E² = max(P², d² − (`EXPLAINED` spread)²),    P² = 2 `PRIOR`²

    with d = ‖m(p) − o(p)‖, m the model's motion projected into the image (`Scene.render`: `motion`), o the observed motion between these
    frames in the same direction. It is the root of the mean square of an error of which d is what is seen, where o itself is wrong by its
    spread: d where motion is seen; and the less the motion around says of a place, the nearer to P, unless the model is so far from it that
    the spread does not explain it. NaN where either is not known, which is not the same as 0. On textured tissue o itself is within some
    tenths of a pixel.

    What it cannot see: motion along the line of sight, which hardly moves pixels (at depth z, a change Δz shifts a pixel r away from
    the principal point by about r · Δz / z). Missing motion counts like motion too many: both are a difference.
    """
    difference = np.square(np.asarray(modelled, np.float32) - observed.flow).sum(-1)
    prior, variance = 2 * PRIOR**2, np.square(observed.spread)
    error = np.maximum(prior, difference - EXPLAINED**2 * variance)
    gain = error / (error + variance)
    return np.sqrt(np.square(gain) * difference + (1 - gain) * prior).astype(np.float32)  # NaN stays NaN


class ObservedMotion:
    """Optical flow of every frame to the reference frame, followed from frame to frame; measured as far as it is asked for, then kept.

    All frames are followed, also those that no training saw. Frames before the reference have no motion to show.
    """

    def __init__(self, clip: Clip, reference: int):
        self.clip, self.reference = clip, reference
        width, height = clip.size
        shrink = max(1, round((width * height / PIXELS) ** 0.5))  # whole: pixels that are blurred unevenly are a texture that stands still
        self.size = max(12, round(width / shrink)), max(12, round(height / shrink))
        self._start = log_intensity(self._frame(reference)), self._valid(reference)
        no_motion = np.zeros((self.size[1], self.size[0], 2), np.float16)
        self._measured = [(no_motion, self._start[1], no_motion[..., 0])]  # flow to the reference, where it is seen, and its error
        self._shares = Shares()
        self._followed: Iterator[tuple[np.ndarray, np.ndarray]] = follow(
            (self._frame(i) for i in range(reference, len(clip))), grey=normalized, smoothness=SMOOTHNESS
        )

    def at(self, frame: int) -> Observed:
        """The motion of a frame's pixels to the reference frame, at the size of the clip."""
        while len(self._measured) <= frame - self.reference:
            self._measured.append(self._measure(self.reference + len(self._measured), *next(self._followed)))
        flow, sure, error = self._measured[max(0, frame - self.reference)]
        seen = sure & (frame >= self.reference)
        flow = flow.astype(np.float32)
        whole, spread = from_around(flow, seen)
        if frame >= self.reference:
            share, part = self._shares.of(frame - self.reference, whole)
            whole, spread = np.where(seen[..., None], whole, share[..., None] * whole), part * spread
            whole, spread = with_own(whole, spread, flow, np.where(seen, np.nan, error.astype(np.float32)))
        spread[~self._valid(frame)] = np.nan
        width, height = self.clip.size
        scale = np.array([width / self.size[0], height / self.size[1]], np.float32)
        large = cv2.resize(whole, (width, height), interpolation=cv2.INTER_LINEAR) * scale
        nearest = [cv2.resize(values, (width, height), interpolation=cv2.INTER_NEAREST) for values in (seen.astype(np.uint8), spread)]
        return Observed(large, nearest[0] > 0, nearest[1] * scale.max())

    def _measure(self, here: int, out: np.ndarray, back: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Flow of a frame to the reference, where it is seen, and its error, NaN where it is none of the same tissue."""
        frame, (look, valid) = self._frame(here), self._start
        same = self._valid(here) & (sample(valid.astype(np.float32), back) > 0.99) & consistent(back, out)
        same &= ~around(looks_changed(log_intensity(frame), look, back))
        error, seen = np.where(same, flow_error(frame), np.nan).astype(np.float16), same & (confidence(frame) > TEXTURE)
        known, textured = (sample(values.astype(np.float32), out) > least for values, least in ((same, 0.99), (seen, 0.5)))
        there_too = consistent(out, back)
        self._shares.add(out, there_too & known, there_too & textured)
        return back.astype(np.float16), seen, error

    def _frame(self, index: int) -> np.ndarray:
        return cv2.resize(self.clip.frame(index), self.size, interpolation=cv2.INTER_AREA)

    def _valid(self, index: int) -> np.ndarray:
        return cv2.resize(self.clip.valid(index).astype(np.uint8), self.size, interpolation=cv2.INTER_NEAREST) > 0


def with_own(around: np.ndarray, spread: np.ndarray, flow: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flow [H, W, 2] of what is `around`, ± its spread [H, W], and a place's own, ± its error [H, W], weighed by their precisions.

    Returns the mean and its spread, float32; what is around alone where the error is NaN, and the own flow where the spread is.
    """
    of_around, of_own = (1 / (np.square(value) + LEAST**2) for value in (spread, error))
    share = np.where(np.isnan(of_around), 1, of_own / (of_own + of_around)).astype(np.float32)
    total = np.nan_to_num(of_around) + of_own
    known = np.isfinite(error)
    mean = np.where(known[..., None], share[..., None] * flow + (1 - share[..., None]) * around, around)
    return mean.astype(np.float32), np.where(known, 1 / np.sqrt(total), spread).astype(np.float32)
