"""Nothing is lost: autosave, the journal's clock, recovered work, damaged session files."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QApplication, QMessageBox

from degense.app.features.documents.saver import Saver
from degense.app.session import session_file
from degense.app.session.session_file import DamagedSession
from degense.app.shell.messages import Choice
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.engine.files import free_path

log = logging.getLogger(__name__)


class Autosave(QObject):
    """Saves by itself, and asks what is to become of what a crash or a damaged file left behind."""

    def __init__(self, shell: Shell) -> None:
        super().__init__(shell)
        self.shell, self.session, self.settings = shell, shell.session, shell.settings
        session = self.session
        self._dirty_since: float | None = None
        self._may_leave = False
        self._go_on: Callable[[], object] | None = None  # what waits until a save is over
        self.saver = Saver(session.store, self)
        self.saver.ended.connect(self._saved)
        shell.closed.connect(self.saver.close)
        session.opened.connect(self._opened)
        session.dirty_changed.connect(self._dirty_changed)
        shell.ticked.connect(self.tick)
        shell.may_close.append(self.may_leave)

    # Saving

    def save(self) -> bool:
        """Save what is open; False where that failed at once. The sample is not changed. What goes wrong is the store's `problem`."""
        if self.session.store.unsaved:
            return True
        try:
            if not self.saver.save():
                self.shell.say(f"{self.session.store.folder} is slow: it is being saved while you go on.")
        except DegenseError as error:
            self._failed(error)
            return False
        return True

    def _failed(self, error: DegenseError) -> None:
        self._dirty_since = time.monotonic()  # the next try is an interval away
        log.warning("not saved: %s", error)

    def _saved(self, error: DegenseError | None) -> None:
        """A save that took long is over."""
        if error is not None:
            self._failed(error)
        go_on, self._go_on = self._go_on, None
        if go_on is not None and not self.session.dirty:
            self._may_leave = True
            go_on()
            self._may_leave = False
        elif go_on is not None and error is not None:
            self._ask_to_leave(str(error), go_on)
        elif go_on is not None:
            go_on()  # what was done meanwhile is saved too

    def save_elsewhere(self) -> bool:
        """Ask for a folder, and save and read there from now on; whether that was done."""
        parent = self.shell.ask_folder(f"Save the work on {self.session.name} in a folder elsewhere")
        if parent is None:
            return False
        folder = free_path(parent / f"{self.session.name}-annotations")
        try:
            self.session.store.save_elsewhere(folder)
        except DegenseError as error:
            self.shell.show_error(str(error))
            return False
        self.shell.say(f"Saved in {folder}, and read from there when {self.session.name} is opened again.", 20)
        return True

    def may_leave(self, go_on: Callable[[], object]) -> bool:
        """Whether what is open may be left now. When it cannot be saved the user is asked, and `go_on` called if they leave it so."""
        if self._may_leave or self.session.store.unsaved:
            return True
        waits, self._go_on = self._go_on is not None, None
        try:
            done = self.saver.save()
            if done and self.session.dirty:  # since an earlier save began
                done = self.saver.save()
        except DegenseError as error:
            if not self.session.dirty:
                log.info("the view was not saved: %s", error)
                return True
            self._ask_to_leave(str(error), go_on)
            return False
        if not done and waits:
            self._ask_to_leave(f"{self.session.store.folder} does not answer: what was done may not be saved there.", go_on)
        elif not done:
            self._go_on = go_on
            self.shell.say(f"{self.session.store.folder} is slow: this goes on as soon as everything is saved there.", 60)
        return done

    def stay(self) -> None:
        """What is open is not left after all."""
        self._may_leave = False

    def _ask_to_leave(self, problem: str, go_on: Callable[[], object]) -> None:
        def leave() -> None:
            self._may_leave = True
            go_on()

        store = self.session.store
        elsewhere = Choice("Save elsewhere…", lambda: self.save_elsewhere() and go_on())
        self.shell.ask(
            "unsaved",
            problem,
            *(() if store.elsewhere else (elsewhere,)),
            Choice("Leave without saving", leave),
            Choice("Stay", default=True, escape=True),
            details="What was done since the last save is in the journal on this computer, and is offered at the next start."
            if store.journaled
            else "What was done since the last save is lost when you leave.",
        )

    def tick(self) -> None:
        """Every second: write the journal, and save when it is time; not during a stroke or a drag."""
        self.session.store.write_pending()
        minutes = self.settings.value.autosave
        due = self._dirty_since is not None and minutes and time.monotonic() - self._dirty_since >= 60 * minutes
        if due and QApplication.mouseButtons() == Qt.MouseButton.NoButton:
            self.save()

    def _dirty_changed(self, dirty: bool) -> None:
        self._dirty_since = time.monotonic() if dirty else None

    # What was left behind

    def _opened(self) -> None:
        self._dirty_since, self._may_leave = None, False
        if self.session.store.unsaved:
            self._offer_recovery()

    def _offer_recovery(self) -> None:
        store = self.session.store
        areas = ", ".join(sorted({"view" if entry.state == session_file.VIEW else entry.state for entry in store.unsaved}))
        count = len(store.unsaved)

        def restore() -> None:
            self.shell.attempt(self.session.recover)
            self.shell.say(f"Restored {count} change{'s' if count > 1 else ''}.")

        def discard() -> None:
            self.shell.attempt(store.discard)
            self.shell.say("The recovered work was discarded.")

        self.shell.ask(
            "recovery",
            "Recovered unsaved work",
            Choice("Restore", restore, default=True, escape=True),
            Choice("Discard", discard),
            details=f"The program ended before {count} change{'s' if count > 1 else ''} of {self.session.name} could be saved ({areas}). "
            "Restore them, or go on from what was saved last?",
            icon=QMessageBox.Icon.Information,
        )

    def offer_backups(self, error: DamagedSession, again: Callable[[], None]) -> None:
        """A session file is damaged: open a backup or a fresh view; `again` opens it then. The damaged file is kept."""
        log.error(str(error))

        def after(change: Callable[[], object]) -> Callable[[], None]:
            def act() -> None:
                change()
                again()

            return lambda: self.shell.attempt(act)

        backups = [
            Choice(f"Backup of {session_file.backup_time(path):%d %b %H:%M}", after(partial(session_file.restore, path, error.path)))
            for path in error.backups[:3]
        ]
        self.shell.ask(
            "damaged session",
            str(error),
            *backups,
            Choice("Fresh view", after(partial(session_file.set_aside, error.path))),
            Choice("Cancel", escape=True),
            details="Whatever you choose, the damaged file is kept beside it.",
        )
