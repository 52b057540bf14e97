"""Keeping what the session holds: the session file of a folder, the journal between two saves, and what a crash left behind."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

from degense.app.session import session_file, state_folder
from degense.app.session.folder_locks import FolderHeld, FolderLocks
from degense.app.session.journal import Entry, Journal
from degense.app.session.saving import Reading, Saving, plain
from degense.app.session.session_file import SavedSession
from degense.app.session.state import PersistentState, Signal
from degense.app.session.state_folder import JOURNAL, PLACE
from degense.engine.errors import DegenseError


class SessionStore:
    """The states of a session and the files they live in.

    Every change goes to a journal in the user's state folder first, so that work is safe where its folder cannot be written.
    One session at a time writes: it holds the locks of the journal and of the folder. In a second window nothing is written, and
    `save` says so. A folder that is not there yet is made, and locked, by the first change.
    """

    def __init__(self) -> None:
        self.dirty_changed: Signal[[bool]] = Signal()  # (dirty)
        self.problem_changed: Signal[[str]] = Signal()  # (problem)
        self.states: dict[str, PersistentState] = {}
        self.folder: Path | None = None
        self.unsaved: list[Entry] = []  # what a crash left in the journal. `recover` or `discard` it; until then nothing is written over it
        #: Whether another window holds what is open. It stays so until it is opened again: what is there has changed since.
        self.elsewhere = False
        self.problem = ""  # why the last change could not be written to where it belongs, in one sentence; empty when all is well
        self.changes = 0  # how often what is open was changed, saved or closed
        self._saved = SavedSession()
        self._dirty: set[str] = set()
        self._pending: set[str] = set()
        self._missed: list[Entry] = []  # what the journal could not take yet
        self._own = self._home = self._source = Path()  # the folder where it belongs, that of its journal, and what is open
        self._locks = FolderLocks()
        self._journal: Journal | None = None
        self._saving: Saving | None = None  # what is being written
        self._since: dict[str, bool] = {}  # states that changed since that began, and whether by a record
        self._loading = False

    def register(self, name: str, state: PersistentState) -> None:
        """Hold a state and save it under this name. ValueError when the name is taken."""
        if name in self.states:
            raise ValueError(f"the session already has a state called {name!r}")
        self.states[name] = state
        state.changed.connect(lambda record: self._state_changed(name, state, record))

    # Opening and closing

    def reading(self, own: Path, source: Path, keep: bool, changes: int) -> Reading:
        """What to read of a run or clip, `source`, in any thread. `changes` is ours when the journal held all that had been done."""
        again = state_folder.folder_of(own) in self._locks
        return Reading(own, source.resolve(), keep, self._locks if again else FolderLocks(), again, changes)

    def is_outdated(self, reading: Reading) -> bool:
        """Whether it was read while it was open here, and changed or saved since."""
        return reading.again and reading.changes != self.changes

    def open(self, reading: Reading) -> None:
        """Take over what was read, in the thread of the states.

        DamagedSession when the session file or what a state reads from the folder is damaged. Then nothing is open.
        """
        if reading.damage is not None:
            self.close()
            raise reading.damage
        if reading.again:
            self._locks = FolderLocks()  # which are let go in place of those that stay
        self.close()
        if reading.again:
            reading.read_journal(self.states)
        self._own, self._home, self._source, self._locks = reading.own, reading.home, reading.source, reading.locks
        saved, self._loading = reading.saved, True
        try:
            for take, (name, state) in zip(reading.take, self.states.items(), strict=True):
                take()
                if name in saved.states:
                    state.from_json(saved.states[name], str(reading.path))
        except DegenseError as error:
            self.close()
            raise session_file.DamagedSession(reading.path, str(error)) from error
        finally:
            self._loading = False
        self.folder = reading.folder if reading.keep else None
        self._saved = SavedSession({**saved.states, **self._to_json()}, saved.id)
        self.unsaved, self.elsewhere = list(reading.unsaved), reading.elsewhere
        self._set_problem(reading.problem)

    def close(self) -> None:
        """Clear the states and let the folder go. What was not saved stays in the journal."""
        self.changes += 1
        self.write_pending()
        self._close_journal()
        self._locks.release()
        self.folder = self._saving = None
        self.unsaved, self._saved = [], SavedSession()
        self._dirty.clear()
        self._missed.clear()
        self._loading = True
        for state in self.states.values():
            state.clear()
        self._loading = self.elsewhere = False
        self._set_problem("")

    def _hold(self, place: Path) -> None:
        """Take the lock of the journal's folder or the session's. Errors as `FolderLocks.hold`; FolderHeld: the session is `elsewhere`."""
        try:
            self._locks.hold(place, self._source.name, with_parents=place == self._home)
        except FolderHeld:
            self.elsewhere = True
            raise

    # Saving

    @property
    def dirty(self) -> bool:
        """Whether there is work that the folder does not hold."""
        return bool(self._dirty)

    @property
    def journaled(self) -> bool:
        """Whether the journal holds what the folder does not."""
        return not (self.elsewhere or self._missed or self.folder is None)

    def save(self) -> None:
        """Write all states. Those of the file that nobody registered stay in it. A folder in which nothing was done yet is not made.

        DegenseError when the folder cannot be written or another window holds it; what was there before stays, and so does `dirty`.
        """
        saving = self.begin_save()
        if saving is None:
            return
        try:
            saving.write()
        except DegenseError as error:
            self.fail_save(saving, error)
            raise
        self.end_save(saving)

    def begin_save(self) -> Saving | None:
        """What there is to save now; None where there is nothing. Write it, then call `end_save` or `fail_save`. Errors as `save`."""
        if self.folder is None or not (self.dirty or self.folder.exists()):
            return None
        if self.unsaved:
            raise DegenseError("Decide first what becomes of the recovered work: restore it or discard it.")
        try:
            if self.elsewhere:
                raise DegenseError(self.problem)
            self._hold(self.folder)
        except DegenseError as error:
            if self.dirty:
                self._set_problem(str(error))
            raise
        self.write_pending()
        stored = [storing for state in self.states.values() if (storing := state.storing(self.folder)) is not None]
        saved = SavedSession({**self._saved.states, **self._to_json()}, session_file.new_id())
        moved_from = self._home / PLACE if self.folder != self._own else None
        self._saving = Saving(self.folder, saved, stored, tuple(self._missed), moved_from)
        self._missed.clear()
        self._since.clear()
        self._close_journal()  # the next change opens it again, which says in it what this save holds
        return self._saving

    def end_save(self, saving: Saving) -> None:
        """It is written. What was changed since it began stays in the journal."""
        if saving is not self._saving:
            return  # something else is open by now
        self._saving, self.changes = None, self.changes + 1
        for storing in saving.stored:
            storing.done()
        self._saved = saving.saved
        if not self._since:
            self.discard()
        self._set_problem("")
        self._set_dirty({name for name, recorded in self._since.items() if recorded or self._differs(name)})

    def fail_save(self, saving: Saving, error: DegenseError) -> None:
        """It could not be written, and all is as it was."""
        if saving is not self._saving:
            return
        self._saving = None
        self._missed[:0] = saving.missed
        if self.dirty:
            self._set_problem(str(error))

    def save_elsewhere(self, folder: Path) -> None:
        """Save in another folder, and read and write there from now on. Errors as `save`; then all is as before."""
        before, self.folder = self.folder, folder.resolve()
        try:
            self.save()
        except DegenseError:
            self.folder = before
            raise

    def write_pending(self) -> None:
        """Write the small states that changed since the last time into the journal, and have the disk keep it. Called every second."""
        if self.dirty or self._journal is not None:
            for name in sorted(self._pending):
                self._append(name, self.states[name].to_json())
        self._pending.clear()
        self._write_journal()
        if self._journal is not None:
            try:
                self._journal.sync()
            except DegenseError as error:
                self._set_problem(str(error))

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
                self.states[entry.state].replay(entry.record, str(self._home / JOURNAL))
        except DegenseError:
            self._close_journal()
            session_file.set_aside(self._home / JOURNAL)
            raise
        finally:
            self._loading = False
            self._set_dirty({entry.state for entry in entries if self.states[entry.state].counts})

    def discard(self) -> None:
        """Delete the journal that a crash left."""
        assert self.folder is not None
        self.unsaved = []
        self._close_journal()
        with suppress(OSError):  # one that stays does not continue what is saved then
            (self._home / JOURNAL).unlink(missing_ok=True)

    # Changes

    def _state_changed(self, name: str, state: PersistentState, record: Any) -> None:
        if self._loading or not state.counts:
            return
        self.changes += 1
        self._since[name] = self._since.get(name, False) or record is not None
        if record is None:
            self._set_dirty(self._dirty | {name} if self._saving or self._differs(name) else self._dirty - {name})
            self._pending.add(name)
        else:
            self._set_dirty(self._dirty | {name})
            self._append(name, record)

    def _differs(self, name: str) -> bool:
        return bool(plain(self.states[name].to_json()) != self._saved.states.get(name))

    def _append(self, name: str, record: Any) -> None:
        """Add a record to the journal, where this session may write one."""
        if self.folder is not None and not self.elsewhere:
            self._missed.append(Entry(name, record))
            self._write_journal()

    def _write_journal(self) -> None:
        """Write what the journal has not got yet; it waits where that fails. Whether the folder can be written is found out too."""
        if not self._missed or self.folder is None:
            return
        try:
            self._hold(self._home)
            if self._journal is None:
                begun = self._saving.saved.id if self._saving is not None else ""
                self._journal = Journal(self._home / JOURNAL, self._saved.id, self._source, self.folder, begun)
            while self._missed:
                self._journal.append(self._missed[0].state, self._missed[0].record)
                del self._missed[0]
            self._hold(self.folder)
        except DegenseError as error:
            self._set_problem(str(error))

    def _close_journal(self) -> None:
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def _set_problem(self, problem: str) -> None:
        if problem != self.problem:
            self.problem = problem
            self.problem_changed.emit(problem)

    def _set_dirty(self, names: set[str]) -> None:
        was, self._dirty = self.dirty, names
        if self.dirty != was:
            self.dirty_changed.emit(self.dirty)

    def _to_json(self) -> dict[str, Any]:
        return {name: plain(state.to_json()) for name, state in self.states.items()}
