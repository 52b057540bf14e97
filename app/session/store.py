"""Keeping what the session holds: its parts in the run folder, the journal between two saves, and what a crash left behind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from degense.app.session import journal, session_file
from degense.app.session.journal import Entry, Journal
from degense.app.session.persistent_state import PersistentState
from degense.app.session.session_file import SavedSession
from degense.app.session.signal import Signal
from degense.engine.errors import DegenseError

JOURNAL, LOCK = "session.journal", "session.lock"


class SessionStore:
    """The parts of a session and the files they live in.

    A folder is kept by one session at a time: in a second window on the same run nothing is written, and `save` says so.

    Attributes
    ----------
    unsaved : list of Entry
        What a crash left in the journal. `recover` or `discard` it; until then nothing is written over it.

    Signals
    -------
    dirty_changed(dirty)
    trouble(sentence)
        The journal cannot be written. Said once, until it can be again.
    """

    def __init__(self) -> None:
        self.dirty_changed: Signal[[bool]] = Signal()
        self.trouble: Signal[[str]] = Signal()
        self.parts: dict[str, PersistentState] = {}
        self.folder: Path | None = None
        self.unsaved: list[Entry] = []
        self._saved = SavedSession()
        self._dirty: set[str] = set()
        self._pending: set[str] = set()
        self._lock: FileLock | None = None
        self._journal: Journal | None = None
        self._troubled = self._loading = False

    def register(self, name: str, part: PersistentState) -> None:
        """Hold a part and save it under this name. ValueError when the name is taken."""
        if name in self.parts:
            raise ValueError(f"the session already has a part called {name!r}")
        self.parts[name] = part
        part.changed.connect(lambda record: self._part_changed(name, part, record))

    # Opening and closing

    def open(self, folder: Path, keep: bool = True) -> None:
        """Fill the parts from a run folder, and look whether a crash left something there.

        Parameters
        ----------
        keep : bool
            Whether to write into the folder; not for the sample.

        Raises
        ------
        DamagedSession
            When the session file or what a part finds in it is damaged. Nothing is open then, and nothing was written.
        """
        self.close()
        path = folder / session_file.NAME
        self._saved = session_file.read(path)
        self._loading = True
        try:
            for name, part in self.parts.items():
                part.load(folder)
                if name in self._saved.parts:
                    part.from_json(self._saved.parts[name], str(path))
        except DegenseError as error:
            self._loading = False
            self.close()
            raise session_file.DamagedSession(path, str(error)) from error
        finally:
            self._loading = False
        self.folder = folder if keep else None
        self._saved = SavedSession({**self._saved.parts, **self._states()}, self._saved.id)
        if keep and self._hold():
            left = folder / JOURNAL
            self.unsaved = [entry for entry in journal.entries(left, self._saved.id) if entry.part in self.parts]
            if not journal.continues(left, self._saved.id):
                session_file.set_aside(left)  # of another session file: one that was restored or deleted

    def close(self) -> None:
        """Empty the parts and let the folder go. What was not saved stays in the journal."""
        self.tell_pending()
        if self._journal is not None:
            self._journal.close()
        if self._lock is not None:
            self._lock.release()
        self._journal = self._lock = self.folder = None
        self.unsaved, self._saved = [], SavedSession()
        self._dirty.clear()
        self._loading = True
        for part in self.parts.values():
            part.clear()
        self._loading = self._troubled = False

    @property
    def elsewhere(self) -> bool:
        """Whether another window keeps the open folder."""
        return self.folder is not None and self._lock is None

    def _hold(self) -> bool:
        assert self.folder is not None
        lock = FileLock(self.folder / LOCK, timeout=0)
        try:
            lock.acquire()
        except (Timeout, OSError):  # another window's, or a folder that cannot be written: `save` says which
            return False
        self._lock = lock
        return True

    # Saving

    @property
    def dirty(self) -> bool:
        """Whether there is work that the run folder does not hold."""
        return bool(self._dirty)

    def save(self) -> None:
        """Write all parts. Parts of the file that nobody registered stay in it.

        Raises
        ------
        DegenseError
            When the folder cannot be written or another window keeps it; what was there before stays, and so does `dirty`.
        """
        if self.folder is None:
            return
        if self.unsaved:
            raise DegenseError("Decide first what becomes of the recovered work: restore it or discard it.")
        if self._lock is None and not self._hold():
            raise DegenseError(f"{self.folder} is open in another window, or cannot be written; nothing was saved.")
        for part in self.parts.values():
            part.store(self.folder)
        self._saved = session_file.write(self.folder / session_file.NAME, {**self._saved.parts, **self._states()})
        self._pending.clear()
        if self._journal is not None:
            self._journal.close()
            self._journal = None
        (self.folder / JOURNAL).unlink(missing_ok=True)
        self._set_dirty(set())

    def tell_pending(self) -> None:
        """Tell the journal the states of small parts that changed since the last time. The window calls it every second."""
        if self._lock is None:
            self._pending.clear()
        for name in sorted(self._pending):
            self._tell(name, self.parts[name].to_json())
        self._pending.clear()

    # After a crash

    def recover(self) -> None:
        """Make the changes again that the journal tells of. They stay in it until they are saved.

        Raises
        ------
        RunError
            When a record cannot be used; those before it are made.
        """
        assert self.folder is not None
        entries, self.unsaved = self.unsaved, []
        self._loading = True
        try:
            for entry in entries:
                self.parts[entry.part].replay(entry.record, str(self.folder / JOURNAL))
        finally:
            self._loading = False
            self._set_dirty({entry.part for entry in entries if self.parts[entry.part].counts})

    def discard(self) -> None:
        """Forget what the journal tells of."""
        assert self.folder is not None
        self.unsaved = []
        (self.folder / JOURNAL).unlink(missing_ok=True)

    # Changes

    def _part_changed(self, name: str, part: PersistentState, record: Any) -> None:
        if self._loading or not part.counts:
            return
        if record is None:
            changed = _plain(part.to_json()) != self._saved.parts.get(name)
            self._set_dirty(self._dirty | {name} if changed else self._dirty - {name})
            self._pending.add(name)
        else:
            self._set_dirty(self._dirty | {name})
            if self._lock is not None:
                self._tell(name, record)

    def _tell(self, name: str, record: Any) -> None:
        assert self.folder is not None
        try:
            if self._journal is None:
                self._journal = Journal(self.folder / JOURNAL, self._saved.id)
            self._journal.tell(name, record)
            self._troubled = False
        except DegenseError as error:
            if not self._troubled:
                self._troubled = True
                self.trouble.emit(str(error))

    def _set_dirty(self, names: set[str]) -> None:
        was, self._dirty = self.dirty, names
        if self.dirty != was:
            self.dirty_changed.emit(self.dirty)

    def _states(self) -> dict[str, Any]:
        return {name: _plain(part.to_json()) for name, part in self.parts.items()}


def waiting(folder: Path) -> bool:
    """Whether a run folder holds work that a crash left unsaved. False where its session file is damaged: opening it says so."""
    try:
        return bool(journal.entries(folder / JOURNAL, session_file.read(folder / session_file.NAME).id))
    except DegenseError:
        return False


def _plain(state: Any) -> Any:
    """A state as it comes back from a file: tuples are lists."""
    return json.loads(json.dumps(state))
