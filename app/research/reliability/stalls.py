"""A drive that stalls, as one of a network does: what is opened, renamed, removed, listed or synced on it waits first."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

#: Names of what Python tells before it asks the system (`sys.addaudithook`). What is read and written belongs to a file that was opened.
ASKED = {"open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.listdir", "os.scandir", "os.truncate"}

_stalled: dict[str, float] = {}  # folders and the seconds that they stall


def stall(folder: Path, seconds: float) -> None:
    """From now on everything below a folder stalls for so long, in whichever thread asks; 0 seconds: no longer. Once hooked, always."""
    if not _stalled:
        sys.addaudithook(_wait)
        os.fsync = _slowly(os.fsync)  # type: ignore[assignment]
    _stalled[str(folder.resolve()) + os.sep] = seconds


def _wait(event: str, arguments: tuple[object, ...]) -> None:
    if event in ASKED and arguments and isinstance(arguments[0], str | os.PathLike):
        _stand_still(os.path.abspath(os.fspath(arguments[0])))


def _stand_still(path: str | bytes) -> None:
    place = os.fsdecode(path) + os.sep
    for folder, seconds in _stalled.items():
        if seconds and place.startswith(folder):
            time.sleep(seconds)


def _slowly(fsync: Callable[[int], None]) -> Callable[[int], None]:
    def slowly(file: int) -> None:
        _stand_still(os.readlink(f"/proc/self/fd/{file}"))
        fsync(file)

    return slowly
