"""Votes of optical flow: labels warped along the recording, for thin and fast things that the 4D field does not hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from degense.engine.annotation.packed import pack, unpack
from degense.engine.clip import Clip
from degense.engine.motion import consistent, follow

#: Weight of a label that was warped where forward and backward flow disagree.
INCONSISTENT = 0.2


def nearness(frame: int, sources: Sequence[int]) -> np.ndarray:
    """Weights of corrected frames at another frame, float32 [n], ∝ 1 / d² with d the distance in frames; their sum is 1."""
    distance = np.abs(np.asarray(sources, np.float32) - frame)
    weights = 1 / np.maximum(distance, 0.5) ** 2
    return (weights / weights.sum()).astype(np.float32)


class FlowVotes:
    """Label maps of the corrected frames, warped to every frame up to the next corrected one. Call `measure` to the end before asking.

    `labels` int64 [H, W] by frame are 0 … count − 1; votes are wanted for `frames`, ascending, without gaps.
    """

    def __init__(self, clip: Clip, labels: Mapping[int, np.ndarray], count: int, frames: Sequence[int]):
        self._clip, self._labels, self._count = clip, labels, count
        self._shape = clip.size[1], clip.size[0]
        self._spans = list(spans(sorted(labels), frames[0], frames[-1]))
        self._moved: dict[int, dict[int, tuple[bytes, bytes]]] = {}

    @property
    def steps(self) -> int:
        """How many pairs of frames `measure` compares."""
        return sum(len(span) - 1 for span in self._spans)

    def measure(self) -> Iterator[int]:
        """Follow the flow; yields after each step the frame that was reached."""
        for span in self._spans:
            labels = self._labels[span[0]].astype(np.uint8)
            reached = follow(self._clip.frame(i) for i in span)
            for frame, (out, back) in zip(span[1:], reached, strict=True):
                moved, inside = warped_labels(labels, back)
                agrees = consistent(back, out) & inside
                self._moved.setdefault(frame, {})[span[0]] = pack(moved), pack(agrees)
                yield frame

    def at(self, frame: int) -> np.ndarray:
        """Weights of the labels in each pixel, float32 [H, W, count], at most 1."""
        found = self._moved.get(frame, {})
        votes = np.zeros((*self._shape, self._count), np.float32)
        for weight, (moved, agrees) in zip(nearness(frame, list(found)) if found else (), found.values(), strict=True):
            certain = np.where(unpack(agrees, self._shape), 1.0, INCONSISTENT).astype(np.float32) * weight
            index = unpack(moved, self._shape)[..., None].astype(np.int64)
            np.put_along_axis(votes, index, np.take_along_axis(votes, index, -1) + certain[..., None], -1)
        return votes


def spans(sources: Sequence[int], first: int, last: int) -> Iterator[list[int]]:
    """From each corrected frame forwards and backwards, up to but not including the next corrected frame or beyond the ends."""
    for before, here, after in zip([None, *sources[:-1]], sources, [*sources[1:], None], strict=True):
        forwards = list(range(here, min(last, after - 1 if after is not None else last) + 1))
        backwards = list(range(here, max(first, before + 1 if before is not None else first) - 1, -1))
        for span in (forwards, backwards):
            if len(span) > 1:
                yield span


def warped_labels(labels: np.ndarray, back: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels uint8 [H, W] seen where a flow float32 [H, W, 2] from the other frame leads (nearest pixel), and where it stays inside."""
    height, width = labels.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x, y = x + back[..., 0], y + back[..., 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    column = np.clip(np.nan_to_num(x).round(), 0, width - 1).astype(np.intp)
    row = np.clip(np.nan_to_num(y).round(), 0, height - 1).astype(np.intp)
    return labels[row, column], inside
