"""What is killed: programs that write, each with the check of what they leave."""

from __future__ import annotations

import os
import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from degense.app.research.reliability import samples
from degense.app.research.reliability.kills import exports, trainings
from degense.app.research.reliability.kills.program import Killed, Program
from degense.app.research.reliability.readers.sessions import opened_session
from degense.engine.progress import finish

#: Seconds of painting that a power cut may take.
ALLOWED = 2.0
#: How often a run changes before its index is made from nothing again.
CHANGES = 10


def programs() -> list[Program]:
    """Those of the campaign."""
    return [
        *trainings.programs(),
        Program("annotate", lambda folder: None, _annotate, _check_annotations, lambda folder: (folder / "strokes").exists()),
        Program("export", trainings.small_run, exports.work, exports.check, exports.begun),
        Program("index", _prepare_index, _index, _check_index, lambda folder: _index_of(folder / "out").exists(), by_system_calls=True),
    ]


# -- painting ------------------------------------------------------------------------------------------------------------------------------
def _annotate(folder: Path) -> None:
    """A stroke of one pixel every 20 ms, a tick every second and a save every five, as the window does; told outside when it is done."""
    from degense.engine.annotation.painting import PixelRegion

    (folder / "out").mkdir(exist_ok=True)
    session, annotations = opened_session(folder / "out")
    said = os.open(folder / "strokes", os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    begin = time.monotonic()
    ticks = 0
    for stroke in range(samples.WIDTH * samples.HEIGHT):
        row, column = divmod(stroke, samples.WIDTH)
        annotations.paint("Brush", PixelRegion(row, column, np.ones((1, 1), bool)), 1)
        os.write(said, f"{time.monotonic()}\n".encode())
        if time.monotonic() - begin > ticks + 1:
            ticks += 1
            session.store.write_pending()
            if ticks % 5 == 0:
                session.save()
        time.sleep(0.02)


def _check_annotations(folder: Path, killed: Killed) -> None:
    """Every stroke that was told is there; after a power cut those of the last two seconds may be lost."""
    log = folder / "strokes"
    told = [float(line) for line in log.read_text(encoding="ascii").split()] if log.exists() else []
    safe = sum(at < killed.moment - (ALLOWED if killed.power else 0.0) for at in told)
    (folder / "out").mkdir(exist_ok=True)
    session, annotations = opened_session(folder / "out")
    if session.store.unsaved:
        session.recover()
    found = int((annotations.labels(0) == 1).sum())
    session.close()
    assert found >= safe, f"{found} of {safe} strokes are left, {len(told)} were made"


# -- the index of an archive ---------------------------------------------------------------------------------------------------------------
def _index_of(folder: Path) -> Path:
    from degense.engine.archive.index_file import INDEX

    return folder / INDEX


def _prepare_index(folder: Path) -> None:
    from degense.engine.archive.indexing import update_index

    for place in ("out", "undisturbed"):
        trainings.small_run(folder, f"{place}/one")
        finish(update_index(folder / place))


def _index(folder: Path) -> None:
    """The index is brought up to date after each change of the run, and then made from nothing, again and again."""
    from degense.engine.archive.indexing import update_index

    while True:
        for change in range(CHANGES):
            os.utime(folder / "out" / "one" / "run.json", (change, change))
            finish(update_index(folder / "out"))
        _index_of(folder / "out").unlink()


def _check_index(folder: Path, killed: Killed) -> None:
    """Brought up to date once more, it holds what an undisturbed one does."""
    from degense.engine.archive.index_file import open_index
    from degense.engine.archive.indexing import update_index

    finish(update_index(folder / "out"))
    with open_index(_index_of(folder / "out")) as index:
        assert [(run.path.name, run.error) for run in index.runs()] == [("one", "")]
    found, undisturbed = (_rows(_index_of(folder / place)) for place in ("out", "undisturbed"))
    assert found == undisturbed, "the index holds something else than an undisturbed one"


def _rows(path: Path) -> list[Any]:
    """What an index holds, but for the times of the runs' files."""
    with closing(sqlite3.connect(path)) as index:
        assert index.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        tables = ("id, path, facts, error FROM runs", "* FROM columns", "* FROM pictures")
        return [sorted(index.execute(f"SELECT {table}").fetchall()) for table in tables]
