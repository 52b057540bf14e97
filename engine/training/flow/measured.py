"""Optical flow measured between training frames: of neighbours, and between a few key frames and all others.

Neighbours are matched directly, which is exact for small motion. The way to a key frame is followed from frame to frame, since a direct
match of far frames passes the forward-backward check while being wrong by many pixels. What one key frame does not show, since an
instrument lies on it or it lies outside of the picture, another does, and the way to the nearest one is short.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np

from degense.engine.motion import follow, steps_between
from degense.engine.threads import abandonable_pool

KEY_FRAMES = 3  # at 0, 1/3 and 2/3 of the training frames

#: Flow of a pair of frames there and back, float32 [h, w, 2], pixels.
MeasuredFlow: TypeAlias = tuple[np.ndarray, np.ndarray]


def key_frames(count: int) -> list[int]:
    """Which of so many training frames, by their number among these, are followed to all others; the first of them is one."""
    return sorted({number * (count - 1) // KEY_FRAMES for number in range(KEY_FRAMES)})


def flow_pairs(count: int) -> list[tuple[int, int]]:
    """The pairs of frames, by number, that `measure_flow` gives in this order: neighbours, then key frames and ever farther ones."""
    return [(k, k + 1) for k in range(count - 1)] + [
        (key, key + way) for distance in range(2, count) for key, way in _reached(count, distance) if _once(count, key, key + way)
    ]


def measure_flow(frames: Sequence[np.ndarray]) -> Iterator[MeasuredFlow]:
    """Flow between training frames, uint8 [h, w, 3], in the order of `flow_pairs`."""
    steps: list[MeasuredFlow] = []
    for step in steps_between(frames):
        steps.append(step)
        yield step
    count = len(frames)
    chains = {}
    for key in key_frames(count):
        chains[key, 1] = follow(frames[key:], iter(steps[key:]))
        chains[key, -1] = follow(frames[key::-1], ((back, there) for there, back in reversed(steps[:key])))
    with abandonable_pool(len(chains)) as pool:
        for distance in range(1, count):
            reached = _reached(count, distance)
            found = pool.map(next, [chains[key, 1 if way > 0 else -1] for key, way in reached])
            for (key, way), flow in zip(reached, found, strict=True):
                if distance > 1 and _once(count, key, key + way):
                    yield flow


def _reached(count: int, distance: int) -> list[tuple[int, int]]:
    """Key frames, and the ways from them, ± this distance, that end within the clip."""
    return [(key, way) for key in key_frames(count) for way in (distance, -distance) if 0 <= key + way < count]


def _once(count: int, key: int, other: int) -> bool:
    """False for the second of the two ways between two key frames."""
    return other > key or other not in key_frames(count)
