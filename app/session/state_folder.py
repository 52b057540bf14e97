"""The user's state folder: the journals of this computer, wherever the work itself is saved, and where work went that had to be moved."""

from __future__ import annotations

import hashlib
import logging
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import platformdirs
from filelock import FileLock, Timeout

from degense.app.session import journal, session_file
from degense.engine.errors import DegenseError

log = logging.getLogger(__name__)

JOURNAL, LOCK, PLACE = "session.journal", "session.lock", "saved-in.txt"


def _sessions() -> Path:
    return Path(platformdirs.user_state_dir("degense", appauthor=False)) / "sessions"


def folder_of(folder: Path) -> Path:
    """Where the journal lies of what is saved in `folder`."""
    place = folder.resolve()
    return _sessions() / f"{place.parent.name}-{hashlib.sha256(str(place).encode()).hexdigest()[:16]}"


def left_behind() -> list[Path]:
    """Runs and clips of which a journal holds work that was not saved and that no window has open, the newest first."""
    found = []
    for path in _sessions().glob(f"*/{JOURNAL}"):
        try:
            head, changed = journal.header(path), path.stat().st_mtime
            saved = session_file.read(Path(head["folder"]) / session_file.NAME).id
            with FileLock(path.with_name(LOCK), timeout=0):
                if journal.entries(path, saved) and Path(head["source"]).exists():
                    found.append((changed, Path(head["source"])))
        except (DegenseError, KeyError, TypeError, OSError) as error:
            log.info("%s is not offered: %s", path, error)
    return [source for _, source in sorted(found, reverse=True)]


def left_in_journal(home: Path, folder: Path, id: str) -> list[journal.Entry]:
    """What the journal in `home` holds since the session file with this id, in `folder`; one of another session file is set aside."""
    left = home / JOURNAL
    if (folder / JOURNAL).is_file() and not left.exists():  # as earlier versions kept it
        shutil.copyfile(folder / JOURNAL, left)
        with suppress(OSError):
            (folder / JOURNAL).unlink()
    found = journal.entries(left, id)
    if not journal.continues(left, id):
        session_file.set_aside(left)  # of a session file that was restored or deleted
    return found


def saved_in(folder: Path) -> Path:
    """Where what belongs into `folder` is saved: there, unless it was saved elsewhere and still is there."""
    try:
        other = Path((folder_of(folder) / PLACE).read_text(encoding="utf-8"))
    except OSError:
        return folder
    return other if other.is_dir() else folder


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Meanwhile no window opens what is saved in `folder`. DegenseError when one has it open."""
    home = folder_of(folder)
    home.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(home / LOCK, timeout=0):
            yield
    except Timeout as error:
        raise DegenseError(f"{folder} is open in a window: close it there first.") from error
