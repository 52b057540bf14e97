"""A question asked of all runs of an index at once."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from degense.engine.archive.answers import Answers
from degense.engine.archive.columns import Columns
from degense.engine.archive.index_file import IndexedRun, IndexFile
from degense.engine.archive.names import NeedsRun, Things
from degense.engine.errors import PromptError
from degense.engine.semantics.moments import Moment, expressions, frames_of
from degense.engine.vocabulary.questions import Expression, Question, heads, read_question


class FoundMoments(Sequence[Moment]):
    """Moments of a run as numbers [n, 3] of first, last and peak, and areas [n]; each is made when it is looked at."""

    def __init__(self, frames: np.ndarray, areas: np.ndarray) -> None:
        self._frames, self._areas = frames, areas

    def __len__(self) -> int:
        return len(self._areas)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return FoundMoments(self._frames[index], self._areas[index])
        first, last, peak = self._frames[index].tolist()
        return Moment(first, last, peak, float(self._areas[index]))


@dataclass(frozen=True)
class Hit:
    """A run that answers."""

    run: IndexedRun
    answering: int  # frames
    moments: Sequence[Moment]


@dataclass(frozen=True)
class Found:
    """What an index says to a question."""

    hits: tuple[Hit, ...]  # the run of which the largest share of frames answers comes first
    unanswered: tuple[tuple[IndexedRun, str], ...]  # runs that only answer when they are opened, and why
    broken: tuple[IndexedRun, ...]  # runs that could not be indexed
    searched: int = 0  # runs that were asked

    @property
    def moments(self) -> int:
        return sum(len(hit.moments) for hit in self.hits)


@dataclass(frozen=True)
class Measures:
    """What is known of the first thing that a question names, in one frame."""

    confidence: float  # in [0, 1], as `FrameSemantics.confidence`
    displacement: tuple[float, ...]  # at `frame_facts.PERCENTILES` of its mask, in the unit of the run


def search(index: IndexFile, text: str, runs: Sequence[IndexedRun] | None = None) -> Found:
    """Ask all runs, or those that are given, without opening any.

    PromptError where no run understands the question, DegenseError for a damaged index.
    """
    known = index.runs() if runs is None else list(runs)
    groups: dict[Things, list[IndexedRun]] = defaultdict(list)
    for run in known:
        if not run.error:
            groups[run.things].append(run)
    hits: list[Hit] = []
    unanswered: list[tuple[IndexedRun, str]] = []
    refused: list[PromptError] = []
    for things, members in groups.items():
        try:
            hits += _asked(index, members, read_question(text, things.classes), unanswered)
        except PromptError as error:  # a name that only the classes of other runs know
            refused.append(error)
            unanswered += [(run, str(error)) for run in members]
    if refused and len(refused) == len(groups):
        raise refused[0]
    if not groups:
        read_question(text, ())
    hits.sort(key=lambda hit: (-hit.answering / hit.run.frames, hit.run.path))
    broken = tuple(run for run in known if run.error)
    return Found(tuple(hits), tuple(unanswered), broken, len(known) - len(broken))


def measures(index: IndexFile, run: IndexedRun, text: str, frame: int) -> Measures | None:
    """Of what a hit shows in a frame; None where its first name is no thing of the run."""
    try:
        thing = run.things.meant(heads(read_question(text, run.things.classes).what)[0])
    except (NeedsRun, PromptError):
        return None
    if thing is None:
        return None
    lengths = {run.id: run.frames}
    confidence, displacement = (index.columns(kind, thing, "", lengths).get(run.id) for kind in ("confidence", "displacement"))
    if confidence is None or displacement is None:
        return None
    return Measures(float(confidence[frame]), tuple(map(float, displacement[frame])))


def _asked(index: IndexFile, runs: list[IndexedRun], question: Question, unanswered: list[tuple[IndexedRun, str]]) -> Iterable[Hit]:
    """The hits among runs with the same things. Where their masks decide whether an index can answer, each is asked for itself."""
    columns = Columns(index, runs)
    try:
        answers = Answers(columns)
        areas = {part: answers.area(part) for part in expressions(question)}
    except NeedsRun as error:
        if len(runs) == 1:
            unanswered.append((runs[0], str(error)))
            return []
        return [hit for run in runs for hit in _asked(index, [run], question, unanswered)]
    return _hits(columns, question, areas)


def _hits(columns: Columns, question: Question, areas: dict[Expression, np.ndarray]) -> list[Hit]:
    starts, area = columns.starts, areas[question.what]
    if question.times:
        kept = np.zeros(columns.frames, bool)
        for first, end in pairwise(starts):
            if question.absent or area[first:end].any():
                kept[first:end] = frames_of(question, {part: values[first:end] for part, values in areas.items()})
    else:
        kept = area == 0 if question.absent else area > 0
    frames, most = _moments(kept, area, starts)
    answering = np.add.reduceat(kept.astype(np.int64), starts[:-1])
    ends = np.searchsorted(frames[:, 0], starts)
    hits = []
    for number in np.flatnonzero(answering):
        run, rows = columns.runs[number], slice(ends[number], ends[number + 1])
        pixels = run.size[0] * run.size[1]
        hits.append(Hit(run, int(answering[number]), FoundMoments(frames[rows] - starts[number], most[rows] / pixels)))
    return hits


def _moments(kept: np.ndarray, area: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`semantics.moments.moments` of runs end to end, which begin at `starts`: first, last and peak [n, 3], and the area there [n]."""
    before, after = np.roll(kept, 1), np.roll(kept, -1)
    before[starts[:-1]], after[starts[1:] - 1] = False, False
    first, last = np.flatnonzero(kept & ~before), np.flatnonzero(kept & ~after)
    if not len(first):
        return np.zeros((0, 3), np.int64), np.zeros(0)
    inside = np.flatnonzero(kept)
    lengths = last - first + 1
    begins = np.concatenate([[0], lengths.cumsum()[:-1]])
    values = area[inside]
    most = np.maximum.reduceat(values, begins)
    candidates = np.flatnonzero(values == np.repeat(most, lengths))
    peak = inside[candidates[np.searchsorted(candidates, begins)]]
    return np.stack([first, last, peak], 1), most
