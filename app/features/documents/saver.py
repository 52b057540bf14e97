"""Saving in a thread of its own: the window goes on while a drive stalls."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor, wait

from PySide6.QtCore import QObject, QTimer, Signal

from degense.app.session.saving import Saving
from degense.app.session.store import SessionStore
from degense.engine.errors import DegenseError

PATIENCE = 0.15  # seconds that the window waits for a save; one that takes longer goes on beside it
POLL_MS = 20


class Saver(QObject):
    """One save at a time."""

    ended = Signal(object)  # (the DegenseError, or None) a save that took longer than `PATIENCE` is over

    def __init__(self, store: SessionStore, parent: QObject) -> None:
        super().__init__(parent)
        self._store, self._thread = store, ThreadPoolExecutor(1, "saving")
        self._saving: tuple[Saving, Future[None]] | None = None
        self._poll = QTimer(self, interval=POLL_MS)
        self._poll.timeout.connect(self._look)

    @property
    def running(self) -> bool:
        return self._saving is not None

    def save(self) -> bool:
        """Save what is open; whether that is done already, else `ended` tells. DegenseError when it is known at once that it cannot be."""
        if self._saving is None:
            saving = self._store.begin_save()
            if saving is None:
                return True
            self._saving = saving, self._thread.submit(saving.write)
        wait([self._saving[1]], PATIENCE)
        if not self._saving[1].done():
            self._poll.start()
            return False
        if (error := self._end()) is not None:
            raise error
        return True

    def close(self) -> None:
        """What is being written still is, by a thread that the program waits for."""
        self._poll.stop()
        self._thread.shutdown(wait=False)

    def _look(self) -> None:
        if self._saving is not None and self._saving[1].done():
            self.ended.emit(self._end())

    def _end(self) -> DegenseError | None:
        assert self._saving is not None
        (saving, written), self._saving = self._saving, None
        self._poll.stop()
        try:
            written.result()
        except DegenseError as error:
            self._store.fail_save(saving, error)
            return error
        self._store.end_save(saving)
        return None
