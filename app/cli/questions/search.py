"""`degense search`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.prompts.segment import folder_name
from degense.engine.errors import DegenseError
from degense.engine.files import replacing, write_text

if TYPE_CHECKING:
    from degense.engine.archive.index_file import IndexedRun
    from degense.engine.archive.listing import Line
    from degense.engine.archive.search import Found

#: Sentences of runs that are printed in full; the rest is a number.
TOLD = 5


def search(options: argparse.Namespace) -> None:
    """Bring the index of a folder up to date, ask it, and open the runs that it cannot answer for where that is wished."""
    from degense.engine.archive.index_file import INDEX, open_index
    from degense.engine.archive.indexing import update_index
    from degense.engine.archive.listing import list_moments
    from degense.engine.archive.opening import ask_runs
    from degense.engine.archive.search import search as ask
    from degense.engine.scene.anonymous import LEFT_OUT

    if not options.as_is:
        update = run_steps(update_index(options.folder), Bar())
        if update.busy:
            print("degense: another program is indexing; these are the answers of what it has indexed.", file=sys.stderr)
    path = options.folder / INDEX
    if not path.exists():
        raise DegenseError(f"{options.folder} has no index yet; leave out --as-is to have it made.")
    written: list[dict[str, Any]] = []
    with open_index(path) as index:
        runs = index.runs()
        for number, text in enumerate(options.prompts, 1):
            found = ask(index, text, runs)
            if options.open:
                hits, refused = run_steps(ask_runs(options.folder, [run for run, _ in found.unanswered], text), Bar())
                found = replace(found, hits=(*found.hits, *hits), unanswered=tuple(refused))
            if options.anonymise:
                found = _anonymous(found, runs)
            pictures = None if options.thumbnails is None else options.thumbnails / folder_name(number, text)
            lines = list_moments(index, found, text, options.limit, pictures is not None)
            print("\n".join(_told(text, found, lines)))
            if pictures is not None:
                print(f"{pictures}: {_write_pictures(lines, pictures)} pictures")
            if options.json is not None:
                written.append(_json(text, found, lines))
    if options.json is not None:
        folder = LEFT_OUT if options.anonymise else str(options.folder)
        write_text(options.json, json.dumps({"folder": folder, "questions": written}, ensure_ascii=False))


def _anonymous(found: Found, runs: Sequence[IndexedRun]) -> Found:
    """The same with runs numbered from 1 in the order of the index, and without the sentences about them, which may name files."""
    from degense.engine.scene.anonymous import LEFT_OUT, RUN_NAME

    numbers = {run.id: number for number, run in enumerate(runs, 1)}

    def numbered(run: IndexedRun) -> IndexedRun:
        return replace(run, path=PurePosixPath(f"{RUN_NAME}-{numbers[run.id]}"), error=run.error and LEFT_OUT)

    return replace(
        found,
        hits=tuple(replace(hit, run=numbered(hit.run)) for hit in found.hits),
        unanswered=tuple((numbered(run), LEFT_OUT) for run, _ in found.unanswered),
        broken=tuple(numbered(run) for run in found.broken),
    )


def _told(text: str, found: Found, listed: Sequence[Line]) -> list[str]:
    lines = [f"{text}: {_plural(found.moments, 'moment')} in {len(found.hits)} of {_plural(found.searched, 'run')}"]
    for run, moment in ((line.run, line.moment) for line in listed):
        when = f"{moment.first / run.fps:.2f} to {moment.last / run.fps:.2f} s"
        most = f"{moment.area:.1%} of the picture at most, in frame {moment.peak}"
        lines.append(f"  {run.path}: frames {moment.first} to {moment.last} ({when}): {most}")
    if found.moments > len(listed):
        lines.append(f"  … and {found.moments - len(listed)} more (--limit)")
    lines += _some("  not answered from the index (--open asks the run)", found.unanswered)
    return lines + _some("  not indexed", [(run, run.error) for run in found.broken])


def _some(title: str, runs: Any) -> list[str]:
    lines = [f"{title}: {run.path}: {why}" for run, why in runs[:TOLD]]
    return [*lines, *([f"{title}: {len(runs) - TOLD} more"] if len(runs) > TOLD else [])]


def _plural(count: int, what: str) -> str:
    return f"{count:,} {what}{'s' * (count != 1)}"


def _write_pictures(lines: Sequence[Line], folder: Path) -> int:
    """The picture nearest to the peak of each moment, named by its place in the list; how many there are."""
    shown = [(number, line.picture) for number, line in enumerate(lines, 1) if line.picture is not None]
    for number, picture in shown:
        with replacing(folder / f"{number:04d}.jpg") as temporary:
            temporary.write_bytes(picture)
    return len(shown)


def _json(text: str, found: Found, listed: Sequence[Line]) -> dict[str, Any]:
    """All moments, those that are listed with what is known of them."""

    def told(runs: Sequence[tuple[IndexedRun, str]]) -> list[dict[str, str]]:
        return [{"run": run.path.as_posix(), "why": why} for run, why in runs]

    moments = [
        {"run": hit.run.path.as_posix(), "fps": hit.run.fps, "unit": hit.run.unit, **vars(moment)}
        for hit in found.hits
        for moment in hit.moments
    ]
    for row, line in zip(moments, listed, strict=False):
        row |= {} if line.known is None else vars(line.known)
    return {
        "question": text,
        "runs": found.searched,
        "moments": moments,
        "unanswered": told(found.unanswered),
        "broken": told([(run, run.error) for run in found.broken]),
    }
