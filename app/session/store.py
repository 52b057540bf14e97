"""Keeping what the session holds: the session file of a folder, the journal between two saves, and what a crash left behind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from degense.app.session import journal, session_file
from degense.app.session.journal import Entry, Journal
from degense.app.session.session_file import SavedSession
from degense.app.session.state import PersistentState, Signal
from degense.engine.errors import DegenseError

JOURNAL, LOCK = "session.journal", "session.lock"


class SessionStore:
    """The states of a session and the files they live in.

    One session at a time writes into a folder: it holds the lock. In a second window nothing is written, and `save` says so. A folder
    that is not there yet is made, and locked, by the first change.

    Signals
    -------
    dirty_changed(dirty)
    trouble(sentence)
        Changes cannot be written to the journal. Emitted once, until they can be again.
    """

    def __init__(self) -> None:
        self.dirty_changed: Signal[[bool]] = Signal()
        self.trouble: Signal[[str]] = Signal()
        self.states: dict[str, PersistentState] = {}
        self.folder: Path | None = None
        self.unsaved: list[Entry] = []  # what a crash left in the journal. `recover` or `discard` it; until then nothing is written over it
        self.elsewhere = False  # whether another window holds the open folder, or it cannot be written
        self._saved = SavedSession()
        self._dirty: set[str] = set()
        self._pending: set[str] = set()
        self._lock: FileLock | None = None
        self._journal: Journal | None = None
        self._troubled = self._loading = False

    def register(self, name: str, state: PersistentState) -> None:
        """Hold a state and save it under this name. ValueError when the name is taken."""
        if name in self.states:
            raise ValueError(f"the session already has a state called {name!r}")
        self.states[name] = state
        state.changed.connect(lambda record: self._state_changed(name, state, record))

    # Opening and closing

    def open(self, folder: Path, keep: bool = True) -> None:
        """Read the states from a folder, and what a crash left in its journal.

        `keep` says whether to write into the folder; not for the sample.
        DamagedSession when the session file or what a state reads from the folder is damaged. Then nothing is open, and nothing written.
        """
        self.close()
        path = folder / session_file.NAME
        self._saved = session_file.read(path)
        self._loading = True
        try:
            for name, state in self.states.items():
                state.load(folder)
                if name in self._saved.states:
                    state.from_json(self._saved.states[name], str(path))
        except DegenseError as error:
            self._loading = False
            self.close()
            raise session_file.DamagedSession(path, str(error)) from error
        finally:
            self._loading = False
        self.folder = folder if keep else None
        self._saved = SavedSession({**self._saved.states, **self._to_json()}, self._saved.id)
        if keep and folder.is_dir() and self._hold():
            left = folder / JOURNAL
            self.unsaved = [entry for entry in journal.entries(left, self._saved.id) if entry.state in self.states]
            if not journal.continues(left, self._saved.id):
                session_file.set_aside(left)  # of another session file: one that was restored or deleted

    def close(self) -> None:
        """Clear the states and let the folder go. What was not saved stays in the journal."""
        self.write_pending()
        self._close_journal()
        if self._lock is not None:
            self._lock.release()
        self._lock = self.folder = None
        self.unsaved, self._saved = [], SavedSession()
        self._dirty.clear()
        self._loading = True
        for state in self.states.values():
            state.clear()
        self._loading = self._troubled = self.elsewhere = False

    def _hold(self) -> bool:
        """Take the lock of the folder, which is made where it is missing; whether this session holds it."""
        assert self.folder is not None
        if self._lock is None:
            lock = FileLock(self.folder / LOCK, timeout=0)
            try:
                self.folder.mkdir(exist_ok=True)
                lock.acquire()
            except (Timeout, OSError):  # another window holds it, or the folder cannot be written
                self.elsewhere = True
                return False
            self._lock, self.elsewhere = lock, False
        return True

    # Saving

    @property
    def dirty(self) -> bool:
        """Whether there is work that the folder does not hold."""
        return bool(self._dirty)

    def save(self) -> None:
        """Write all states. Those of the file that nobody registered stay in it. A folder in which nothing was done yet is not made.

        DegenseError when the folder cannot be written or another window holds it; what was there before stays, and so does `dirty`.
        """
        if self.folder is None or not (self.dirty or self.folder.exists()):
            return
        if self.unsaved:
            raise DegenseError("Decide first what becomes of the recovered work: restore it or discard it.")
        if not self._hold():
            raise DegenseError(f"{self.folder} is open in another window, or cannot be written; nothing was saved.")
        for state in self.states.values():
            state.store(self.folder)
        self._saved = session_file.write(self.folder / session_file.NAME, {**self._saved.states, **self._to_json()})
        self._pending.clear()
        self._close_journal()
        (self.folder / JOURNAL).unlink(missing_ok=True)
        self._set_dirty(set())

    def write_pending(self) -> None:
        """Write the small states that changed since the last time into the journal. The window calls it every second."""
        if self.dirty or self._journal is not None:
            for name in sorted(self._pending):
                self._append(name, self.states[name].to_json())
        self._pending.clear()

    # After a crash

    def recover(self) -> None:
        """Repeat the changes in the journal. They stay in it until they are saved.

        RunError when a record cannot be used; those before it are applied, and the journal is set aside.
        """
        assert self.folder is not None
        entries, self.unsaved = self.unsaved, []
        self._loading = True
        try:
            for entry in entries:
                self.states[entry.state].replay(entry.record, str(self.folder / JOURNAL))
        except DegenseError:
            self._close_journal()
            session_file.set_aside(self.folder / JOURNAL)
            raise
        finally:
            self._loading = False
            self._set_dirty({entry.state for entry in entries if self.states[entry.state].counts})

    def discard(self) -> None:
        """Delete the journal that a crash left."""
        assert self.folder is not None
        self.unsaved = []
        self._close_journal()
        (self.folder / JOURNAL).unlink(missing_ok=True)

    # Changes

    def _state_changed(self, name: str, state: PersistentState, record: Any) -> None:
        if self._loading or not state.counts:
            return
        if record is None:
            changed = _plain(state.to_json()) != self._saved.states.get(name)
            self._set_dirty(self._dirty | {name} if changed else self._dirty - {name})
            self._pending.add(name)
        else:
            self._set_dirty(self._dirty | {name})
            self._append(name, record)

    def _append(self, name: str, record: Any) -> None:
        """Add a record to the journal, where this session may write one."""
        if self.folder is None or self.elsewhere:
            return
        try:
            if not self._hold():
                raise DegenseError(f"{self.folder} is open in another window, or cannot be written: what you do here will not be saved.")
            if self._journal is None:
                self._journal = Journal(self.folder / JOURNAL, self._saved.id)
            self._journal.append(name, record)
            self._troubled = False
        except DegenseError as error:
            if not self._troubled:
                self._troubled = True
                self.trouble.emit(str(error))

    def _close_journal(self) -> None:
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def _set_dirty(self, names: set[str]) -> None:
        was, self._dirty = self.dirty, names
        if self.dirty != was:
            self.dirty_changed.emit(self.dirty)

    def _to_json(self) -> dict[str, Any]:
        return {name: _plain(state.to_json()) for name, state in self.states.items()}


def waiting(folder: Path) -> bool:
    """Whether a folder holds work that a crash left unsaved. False where its session file is damaged: opening it says so."""
    try:
        return bool(journal.entries(folder / JOURNAL, session_file.read(folder / session_file.NAME).id))
    except DegenseError:
        return False


def _plain(state: Any) -> Any:
    """A state as it comes back from a file: tuples are lists."""
    return json.loads(json.dumps(state))
