"""The moments of an answer one by one, as a list shows them: with what is known of their largest frame, and a picture of it."""

from __future__ import annotations

from dataclasses import dataclass

from degense.engine.archive.index_file import IndexedRun, IndexFile
from degense.engine.archive.names import NeedsRun, Things
from degense.engine.archive.search import Found
from degense.engine.errors import PromptError
from degense.engine.semantics.moments import Moment
from degense.engine.vocabulary.questions import heads, read_question


@dataclass(frozen=True)
class Measures:
    """What is known of the first thing that a question names, in one frame."""

    confidence: float  # in [0, 1], as `FrameSemantics.confidence`
    displacement: tuple[float, ...]  # at `frame_facts.PERCENTILES` of its mask, in the unit of the run


@dataclass(frozen=True)
class Line:
    """A moment that is listed."""

    run: IndexedRun
    moment: Moment
    known: Measures | None  # in the frame of its peak; None where the first name is no thing of the run
    picture: bytes | None = None  # JPEG of the frame nearest to its peak


def list_moments(index: IndexFile, found: Found, text: str, most: int, pictures: bool) -> list[Line]:
    """The first moments of an answer to a text, no more than `most`."""
    lines: list[Line] = []
    named: dict[Things, str | None] = {}
    for hit in found.hits:
        moments = hit.moments[: most - len(lines)]
        if not moments:
            break
        things = hit.run.things
        if things not in named:
            named[things] = _first_named(text, things)
        known = _measures(index, hit.run, named[things], [moment.peak for moment in moments])
        for moment, measured in zip(moments, known, strict=True):
            picture = index.picture(hit.run.id, moment.peak) if pictures else None
            lines.append(Line(hit.run, moment, measured, None if picture is None else picture[1]))
    return lines


def _first_named(text: str, things: Things) -> str | None:
    try:
        return things.meant(heads(read_question(text, things.classes).what)[0])
    except (NeedsRun, PromptError):
        return None


def _measures(index: IndexFile, run: IndexedRun, thing: str | None, frames: list[int]) -> list[Measures | None]:
    if thing is None:
        return [None] * len(frames)
    of_thing = [index.columns(run.things, (kind, thing), {run.id: run.frames}) for kind in ("confidence", "displacement")]
    confidence, displacement = (found.get(run.id) for found in of_thing)
    if confidence is None or displacement is None:
        return [None] * len(frames)
    return [Measures(float(confidence[frame]), tuple(map(float, displacement[frame]))) for frame in frames]
