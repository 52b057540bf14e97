"""Memory that was freed goes back to the system when the worker rests.

The C library keeps what drawing frees in the heap of each thread, for the next drawing: 65 to 71 MB after all frames of the sample
(docs/decisions/0059). Code that ran once goes with it, and once after the first drawing of a window, without waiting for the rest
(docs/decisions/0062).
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable

from PySide6.QtCore import QObject, QTimer

from degense.app.shell.code_pages import give_code_back, much_code
from degense.app.shell.worker import Worker

#: How long the worker has had nothing to do before its memory is given back: not between two frames of a scrub.
REST_MS = 1000
CHANNEL = "memory"


def giver() -> Callable[[], object] | None:
    """What gives freed memory back; None where the C library is not glibc, which alone has to be told."""
    if sys.platform != "linux" or not hasattr(library := ctypes.CDLL(None), "malloc_trim"):
        return None

    def give() -> None:
        library.malloc_trim(0)
        give_code_back(library)

    return give


class SpareMemory(QObject):
    """Lets the worker give freed memory back, once after each time of work, and after its first drawing if code takes much."""

    def __init__(self, worker: Worker, give: Callable[[], object]) -> None:
        super().__init__(worker)
        self._worker, self._give, self._begun = worker, give, False
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
        self._worker.submit(CHANNEL, self._give, lambda result: None, lambda message: None)
