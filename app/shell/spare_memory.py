"""Memory that was freed goes back to the system when the worker rests, and while it works where much has gathered.

The C library keeps what drawing frees in the heap of each thread, for the next drawing: 65 to 71 MB after all frames of the sample
(docs/decisions/0059), and up to 200 where steps of long work come between drawings. Code that ran once goes with it at rest, and once after
the first drawing of a window, without waiting for the rest (docs/decisions/0062).
"""

from __future__ import annotations

import ctypes
import mmap
import sys
from contextlib import suppress
from pathlib import Path

from PySide6.QtCore import QObject, QTimer

from degense.app.shell.code_pages import give_code_back, much_code
from degense.app.shell.worker import Worker

#: How long the worker has had nothing to do before its memory is given back: not between two frames of a scrub.
REST_MS = 1000
CHANNEL = "memory"
GATHERED = 48_000_000  # bytes by which the program may grow at work before it looks what of this is free


class Giver:
    """Gives freed memory back; for Linux with glibc, the one C library that has to be told."""

    def __init__(self) -> None:
        self._library = ctypes.CDLL(None)
        self._least = sys.maxsize  # bytes that the program had of its own, at the least since memory was given back

    def rested(self) -> None:
        """Give back what was freed, and code that ran once."""
        self._give()
        give_code_back(self._library)

    def worked(self) -> None:
        """Give back what was freed where the program has grown by more than `GATHERED`; nothing where it cannot find out."""
        with suppress(OSError):
            self._least = min(self._least, own := _own_memory())
            if own > self._least + GATHERED:
                self._give()

    def _give(self) -> None:
        self._library.malloc_trim(0)
        self._least = _own_memory()


def _own_memory() -> int:
    """Resident memory that holds no pages of files, bytes."""
    _, resident, shared, *_ = map(int, Path("/proc/self/statm").read_text().split())
    return (resident - shared) * mmap.PAGESIZE


def giver() -> Giver | None:
    """What gives freed memory back; None where nothing needs to."""
    return Giver() if sys.platform == "linux" and hasattr(ctypes.CDLL(None), "malloc_trim") else None


class SpareMemory(QObject):
    """Lets the worker give freed memory back, once after each time of work, and after its first drawing if code takes much; and between
    steps of its work where much has gathered."""

    def __init__(self, worker: Worker, giver: Giver) -> None:
        super().__init__(worker)
        self._worker, self._giver, self._begun = worker, giver, False
        worker.after_step = giver.worked
        self._rest = QTimer(self)
        self._rest.setSingleShot(True)
        self._rest.setInterval(REST_MS)
        self._rest.timeout.connect(self._rested)
        worker.add_channel(CHANNEL, 35)
        worker.freed.connect(self._worked)

    def _worked(self, channel: str) -> None:
        if channel != CHANNEL:
            self._rest.start()
            if not self._begun and much_code():  # once: later drawings need their code again
                self._begun = True
                self._submit()

    def _rested(self) -> None:
        if self._worker.idle():  # else it is tried again after what it does
            self._submit()

    def _submit(self) -> None:
        self._worker.submit(CHANNEL, self._giver.rested, lambda result: None, lambda message: None)
