"""A search and what its list shows. No Qt."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.archive.search import Found
    from degense.engine.semantics.moments import Moment

#: Moments that are listed.
MOST = 500


@dataclass(frozen=True)
class Line:
    """A moment in the list."""

    run: Path
    fps: float
    moment: Moment
    picture: bytes | None  # JPEG


@dataclass(frozen=True)
class Results:
    """What the list shows."""

    lines: tuple[Line, ...]
    found: Found
    busy: bool  # another program is indexing


def search_folder(folder: Path, text: str, opening: bool) -> Steps[Results]:
    """Bring the index of a folder up to date and ask it; `opening`: ask runs that it cannot answer for, one by one."""
    from degense.engine.archive.index_file import INDEX, open_index
    from degense.engine.archive.indexing import update_index
    from degense.engine.archive.opening import ask_runs
    from degense.engine.archive.search import search

    update = yield from update_index(folder)
    with open_index(folder / INDEX) as index:
        found = search(index, text)
        if opening and found.unanswered:
            hits, refused = yield from ask_runs(folder, [run for run, _ in found.unanswered], text)
            found = replace(found, hits=(*found.hits, *hits), unanswered=tuple(refused))
        moments = [(hit.run, moment) for hit in found.hits for moment in hit.moments][:MOST]
        lines = []
        for run, moment in moments:
            picture = index.picture(run.id, moment.peak)
            lines.append(Line(folder / run.path, run.fps, moment, None if picture is None else picture[1]))
    return Results(tuple(lines), found, update.busy)
