"""The session file: what the window showed and what was done in it, as named states in JSON; its folder, and its backups."""

from __future__ import annotations

import json
import secrets
import shutil
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from degense.engine.errors import DegenseError, RunError
from degense.engine.files import free_path, replacing, write_text
from degense.engine.untrusted import read_json

NAME, BACKUPS = "session.json", "backups"
#: The name of the view state among the states.
VIEW = "look"
LARGEST = 64 << 20
#: Backups kept, and the seconds that lie between them at least.
KEPT, SPACING = 8, 300


class DamagedSession(RunError):
    """A session file that cannot be used. Nothing was opened; `backups` are there to go on from, the newest first."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path, self.backups = path, backups(path.parent)
        count = len(self.backups)
        offer = f"open one of its {count} backups" if count > 1 else "open its backup" if count else "there is no backup"
        super().__init__(f"{path} is damaged ({reason}): {offer}, or set it aside and start with a fresh view.")


@dataclass(frozen=True)
class SavedSession:
    """What a session file holds: states by name, and the id that a journal refers to (empty when there is no file)."""

    states: dict[str, Any] = field(default_factory=dict)
    id: str = ""


def clip_folder(clip: Path) -> Path:
    """The folder of the session and annotations of a clip (a folder or a file) that has no run."""
    return clip / "annotations" if clip.is_dir() else clip.with_name(f"{clip.stem}-annotations")


def read(path: Path) -> SavedSession:
    """The saved states; none when there is no file. DamagedSession when the file cannot be read or is no session file."""
    try:
        data = read_json(path, LARGEST)
    except FileNotFoundError:
        return SavedSession()
    except OSError as error:
        raise DamagedSession(path, error.strerror or "it cannot be read") from error
    except ValueError as error:
        raise DamagedSession(path, str(error)) from error
    match data:
        case {"id": str(id), "parts": dict(states)}:
            return SavedSession(states, id)
        case {"layer": _}:  # as earlier versions wrote it: the view state alone
            return SavedSession({VIEW: data})
    raise DamagedSession(path, "not the fields of a session")


def new_id() -> str:
    return secrets.token_hex(8)


def write(path: Path, saved: SavedSession) -> None:
    """Replace the file; keep the old one as a backup unless the last backup is younger than `SPACING`.

    DegenseError when it cannot be written whole; the old file stays.
    """
    text = json.dumps({"id": saved.id, "parts": saved.states}, indent=1)
    _back_up(path)
    write_text(path, text)


def backups(folder: Path) -> list[Path]:
    """The backups in a folder, the newest first; none where it cannot be read."""
    try:
        return sorted((folder / BACKUPS).glob("session-*.json"), reverse=True)
    except OSError:
        return []


def backup_time(path: Path) -> datetime:
    """When what a backup holds was saved, in local time."""
    return datetime.fromtimestamp(path.stat().st_mtime)


def set_aside(path: Path) -> Path:
    """Rename a damaged file, so that it is kept but not opened again; the new path. An absent file is left so."""
    aside = free_path(path.with_name(f"{path.name}.bad"))
    try:
        if path.exists():
            path.replace(aside)
    except OSError as error:
        raise DegenseError(f"{path} cannot be set aside: {error.strerror}.") from error
    return aside


def restore(backup: Path, path: Path) -> None:
    """Make a backup the session file; the file in its place is set aside."""
    set_aside(path)
    _copy(backup, path)


def _back_up(path: Path) -> None:
    if not path.is_file():
        return
    kept, saved = backups(path.parent), path.stat().st_mtime
    if kept and saved - kept[0].stat().st_mtime < SPACING:
        return
    _copy(path, path.parent / BACKUPS / f"session-{datetime.fromtimestamp(saved):%Y%m%d-%H%M%S}.json")
    for old in backups(path.parent)[KEPT:]:
        old.unlink(missing_ok=True)


def _copy(source: Path, target: Path) -> None:
    """Copy a file with its time, whole or not at all."""
    with replacing(target) as temporary:
        shutil.copy2(source, temporary)
