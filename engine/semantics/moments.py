"""Expressions over masks in a frame, and moments over time. It knows neither scene nor model: masks come from whoever has some."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from degense.engine.semantics.relations import extreme, related
from degense.engine.vocabulary.questions import AllOf, AnyOf, ButNot, Expression, Extreme, Moments, Noun, Question, Related


def mask_of(expression: Expression, masks: Mapping[str, np.ndarray]) -> np.ndarray:
    """The mask bool [H, W] of an expression in one frame, from those of its nouns by text."""
    if isinstance(expression, Noun):
        return masks[expression.text]
    if isinstance(expression, (AnyOf, AllOf)):
        parts = [mask_of(part, masks) for part in expression.parts]
        there = isinstance(expression, AnyOf) or all(part.any() for part in parts)
        return np.logical_or.reduce(parts) if there else np.zeros_like(parts[0])
    what = mask_of(expression.what, masks)
    if isinstance(expression, ButNot):
        return what & ~mask_of(expression.other, masks)
    if isinstance(expression, Related):
        return related(what, expression.relation, mask_of(expression.to, masks), expression.negated)
    assert isinstance(expression, Extreme)
    return extreme(what, expression.largest)


@dataclass(frozen=True)
class Moment:
    """Consecutive frames that answer a question."""

    first: int
    last: int  # included
    peak: int  # the frame in which the mask is largest
    area: float  # the share of the picture that it covers there


def expressions(question: Question) -> tuple[Expression, ...]:
    """Those whose areas over time `frames_of` reads: of the question, and of those that it is timed by."""
    of_times = (part for time in question.times if time.of is not None for part in expressions(time.of))
    return tuple(dict.fromkeys((question.what, *of_times)))


def frames_of(question: Question, areas: Mapping[Expression, np.ndarray]) -> np.ndarray:
    """Which frames answer a question, bool [frames], from the areas [frames] of its `expressions`."""
    area = areas[question.what]
    kept = area == 0 if question.absent else area > 0
    for time in question.times:
        kept = kept & _allowed(time, kept, area, areas)
    return kept


def moments(kept: np.ndarray, area: np.ndarray) -> tuple[Moment, ...]:
    """Runs of frames, in order of time."""
    return tuple(
        Moment(first, last, peak, float(area[peak]))
        for first, last in _runs(kept)
        for peak in [first + int(area[first : last + 1].argmax())]
    )


def _allowed(time: Moments, kept: np.ndarray, area: np.ndarray, areas: Mapping[Expression, np.ndarray]) -> np.ndarray:
    frames = np.arange(len(kept))
    if time.of is not None:
        other = np.flatnonzero(frames_of(time.of, areas))
        if time.kind in ("when", "when not"):
            return np.isin(frames, other, invert=time.kind == "when not")
        if not len(other):
            return np.zeros_like(kept)
        return frames < other[0] if time.kind == "before" else frames > other[-1]
    if not kept.any():
        return kept
    if time.kind in ("first", "last"):
        first, last = list(_runs(kept))[0 if time.kind == "first" else -1]
        return (frames >= first) & (frames <= last)
    among = np.flatnonzero(kept)
    return frames == among[area[among].argmax() if time.kind == "largest" else area[among].argmin()]


def _runs(kept: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last frame of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], kept, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True)
