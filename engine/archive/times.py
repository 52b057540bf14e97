"""When runs that lie end to end answer, and their moments: `semantics.moments` for all of them at once.

Frames are numbered through; `starts` int [runs + 1] are those that runs begin at, and the end.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from degense.engine.vocabulary.questions import Expression, Moments, Question


def kept_frames(question: Question, areas: Mapping[Expression, np.ndarray], starts: np.ndarray) -> np.ndarray:
    """`semantics.moments.frames_of` of each run, bool [frames]."""
    area = areas[question.what]
    kept = area == 0 if question.absent else area > 0
    for time in question.times:
        if time.of is None:
            kept = _chosen(time.kind, kept, area, starts)
        else:
            kept = kept & _timed(time, kept_frames(time.of, areas, starts), starts)
    return kept


def found_moments(kept: np.ndarray, area: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`semantics.moments.moments` of each run: first, last and peak [n, 3], and the area there [n]."""
    first, last = _stretches(kept, starts)
    inside = np.flatnonzero(kept)
    peak = inside[_largest(area[inside], np.concatenate([[0], (last - first + 1).cumsum()]))]
    return np.stack([first, last, peak], 1), area[peak]


def _timed(time: Moments, other: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """The frames when, before or after something else is there, bool [frames]."""
    if time.kind in ("when", "when not"):
        return other if time.kind == "when" else ~other
    there = np.flatnonzero(other)
    bounds = np.searchsorted(there, starts)
    some = np.flatnonzero(np.diff(bounds))  # runs that it is in
    at = np.full(len(starts) - 1, -1 if time.kind == "before" else len(other))
    at[some] = there[bounds[some]] if time.kind == "before" else there[bounds[some + 1] - 1]
    frames, at = np.arange(len(other)), np.repeat(at, np.diff(starts))
    return frames < at if time.kind == "before" else frames > at


def _chosen(kind: str, kept: np.ndarray, area: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Of the frames that are kept in a run: its first or last stretch, or the one in which the area is largest or smallest."""
    chosen = np.zeros_like(kept)
    if kind in ("first", "last"):
        first, last = _stretches(kept, starts)
        bounds = np.searchsorted(first, starts)
        some = np.flatnonzero(np.diff(bounds))
        for stretch in bounds[some] if kind == "first" else bounds[some + 1] - 1:
            chosen[first[stretch] : last[stretch] + 1] = True
        return chosen
    inside = np.flatnonzero(kept)
    bounds = np.unique(np.searchsorted(inside, starts))
    chosen[inside[_largest(area[inside] if kind == "largest" else -area[inside].astype(np.float64), bounds)]] = True
    return chosen


def _stretches(kept: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last frames of consecutive frames of a run that are kept."""
    before, after = np.roll(kept, 1), np.roll(kept, -1)
    before[starts[:-1]], after[starts[1:] - 1] = False, False
    return np.flatnonzero(kept & ~before), np.flatnonzero(kept & ~after)


def _largest(values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Where the largest value is, the first of several, of each of the parts that end where the next begins; none is empty."""
    if len(bounds) < 2:
        return np.zeros(0, np.int64)
    candidates = np.flatnonzero(values == np.repeat(np.maximum.reduceat(values, bounds[:-1]), np.diff(bounds)))
    return candidates[np.searchsorted(candidates, bounds[:-1])]
