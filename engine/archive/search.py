"""A question asked of all runs of an index at once."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from degense.engine.archive.answers import Answers
from degense.engine.archive.columns import Columns
from degense.engine.archive.index_file import IndexedRun, IndexFile
from degense.engine.archive.names import NeedsRun, Things
from degense.engine.archive.times import found_moments, kept_frames
from degense.engine.errors import PromptError
from degense.engine.semantics.moments import Moment, expressions
from degense.engine.vocabulary.questions import Expression, Question, read_question

FRAMES_AT_ONCE, RUNS_AT_ONCE = 1 << 16, 256


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
            question = read_question(text, things.classes)
            hits += [hit for some in _together(members) for hit in _asked(index, some, question, unanswered)]
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


def _together(runs: Sequence[IndexedRun]) -> Iterator[list[IndexedRun]]:
    """Runs that are asked at once: so few that the processor's cache holds the columns that are computed with."""
    some: list[IndexedRun] = []
    frames = 0
    for run in runs:
        if some and (frames + run.frames > FRAMES_AT_ONCE or len(some) == RUNS_AT_ONCE):
            yield some
            some, frames = [], 0
        some.append(run)
        frames += run.frames
    yield some


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
    kept = kept_frames(question, areas, starts)
    frames, most = found_moments(kept, area, starts)
    answering = np.add.reduceat(kept.astype(np.int64), starts[:-1])
    ends = np.searchsorted(frames[:, 0], starts)
    hits = []
    for number in np.flatnonzero(answering):
        run, rows = columns.runs[number], slice(ends[number], ends[number + 1])
        pixels = run.size[0] * run.size[1]
        hits.append(Hit(run, int(answering[number]), FoundMoments(frames[rows] - starts[number], most[rows] / pixels)))
    return hits
