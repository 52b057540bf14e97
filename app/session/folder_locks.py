"""The locks by which one window alone writes a session."""

from __future__ import annotations

import errno
import os
import threading
from pathlib import Path

from filelock import FileLock, Timeout

from degense.app.session.state_folder import LOCK
from degense.engine.errors import DegenseError
from degense.engine.files import make_folder


class FolderHeld(DegenseError):
    """Another window holds the folder."""


class FolderLocks:
    """The folders that a session holds, in whichever thread they were taken. They are let go when this is forgotten, too."""

    def __init__(self) -> None:
        self._locks: dict[Path, FileLock] = {}
        self._one_at_a_time = threading.Lock()

    def __contains__(self, place: Path) -> bool:
        return place in self._locks

    def hold(self, place: Path, source: str, *, with_parents: bool = False) -> None:
        """Take the lock of a folder, which is made where it is missing; find out whether it can still be written where it is held already.

        `source` is what is open. FolderHeld, or DegenseError when the folder cannot be written.
        """
        try:
            with self._one_at_a_time:
                if place not in self._locks:
                    if with_parents:
                        make_folder(place)
                    else:
                        place.mkdir(exist_ok=True)
                    lock = FileLock(place / LOCK, timeout=0, thread_local=False)
                    lock.acquire()
                    self._locks[place] = lock
                elif not os.access(place, os.W_OK):
                    raise PermissionError(errno.EACCES, "it is gone or read-only now")
        except Timeout as error:
            raise FolderHeld(f"{source} is open in another window: close it there and open it again here to change it.") from error
        except OSError as error:
            raise DegenseError(f"{place} cannot be written ({error.strerror}).") from error

    def release(self) -> None:
        for lock in self._locks.values():
            lock.release()
        self._locks.clear()
