"""Optical flow of a whole clip, measured once for all baselines that follow it."""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from degense.engine.clip import Clip
from degense.engine.metrics.flicker import warped
from degense.engine.motion import chain, consistent, follow, sample, steps_between
from degense.engine.progress import Progress, silent

THREADS = 2


class ClipFlow:
    """Flow between neighbouring frames of a clip, both ways, and what is chained of it.

    All images of the clip are looked at, held-out ones too, as by any tracker; their labels never are.
    """

    def __init__(self, clip: Clip, progress: Progress = silent):
        self._clip = clip
        self._steps: list[tuple[np.ndarray, np.ndarray]] = []
        for done, step in enumerate(steps_between((clip.frame(i) for i in range(len(clip))), THREADS)):
            progress(done / len(clip), "measuring optical flow")
            self._steps.append(step)

    @cached_property
    def from_first(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Flow first → frame and frame → first, float32 [H, W, 2], of each frame after the first (`engine.motion.follow`)."""
        return list(follow((self._clip.frame(i) for i in range(len(self._clip))), self._steps))

    def chained(self, frame: int, sources: list[int]) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """By source frame, the flow from `frame` to it, float32 [H, W, 2], NaN where it leaves the picture on the way, and where every
        step of it is consistent forwards and backwards, bool [H, W]."""
        found = {}
        for direction in (1, -1):
            ahead = [source for source in sources if (source - frame) * direction > 0]
            way = np.zeros((*self._clip.size[::-1], 2), np.float32)
            sure = np.ones(way.shape[:2], bool)
            last = max(ahead, key=lambda source: abs(source - frame), default=frame)
            for here in range(frame, last, direction):
                there, back = self._steps[here] if direction > 0 else self._steps[here - 1][::-1]
                agrees = sample(consistent(there, back).astype(np.float32), way)
                sure = sure & (np.nan_to_num(agrees) > 0.5)
                way = chain(way, there)
                if here + direction in sources:
                    found[here + direction] = way, sure
        if frame in sources:
            found[frame] = np.zeros((*self._clip.size[::-1], 2), np.float32), np.ones(self._clip.size[::-1], bool)
        return found


def warped_filled(labels: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels uint8 [H, W] seen where a flow leads, and where that lies inside the picture; elsewhere those of the nearest pixel inside."""
    moved, inside = warped(labels, way)
    if inside.all() or not inside.any():
        return moved, inside
    _, nearest = cv2.distanceTransformWithLabels((~inside).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    of_pixel = np.zeros(nearest.max() + 1, np.uint8)
    of_pixel[nearest[inside]] = moved[inside]
    return of_pixel[nearest], inside
