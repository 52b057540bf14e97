"""A question asked of all runs of an index at once."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from degense.engine.archive.answers import Answers
from degense.engine.archive.columns import Columns
from degense.engine.archive.index_file import IndexedRun, IndexFile
from degense.engine.archive.names import NeedsRun, Things
from degense.engine.errors import PromptError
from degense.engine.semantics.moments import Moment, expressions, frames_of, moments
from degense.engine.vocabulary.questions import Expression, Question, heads, read_question


@dataclass(frozen=True)
class Hit:
    """A run that answers."""

    run: IndexedRun
    answering: int  # frames
    moments: tuple[Moment, ...]


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
    timed = bool(question.times)
    kept = None if timed else (areas[question.what] == 0 if question.absent else areas[question.what] > 0)
    some = np.ones(len(columns.runs), bool) if kept is None else np.logical_or.reduceat(kept, columns.starts[:-1])
    hits = []
    for number in np.flatnonzero(some):
        run, frames = columns.runs[number], slice(columns.starts[number], columns.starts[number + 1])
        of_run = frames_of(question, {part: values[frames] for part, values in areas.items()}) if kept is None else kept[frames]
        if of_run.any():
            width, height = run.size
            hits.append(Hit(run, int(of_run.sum()), moments(of_run, areas[question.what][frames] / (width * height))))
    return hits
