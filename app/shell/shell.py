"""The window without any feature: docks, actions, services and tasks, which features use when they install themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from PySide6.QtCore import QByteArray, QEvent, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent, QStatusTipEvent
from PySide6.QtWidgets import QFileDialog, QMainWindow, QMessageBox

from degense.app.session.session import Session
from degense.app.shell.actions import Action, ActionRegistry
from degense.app.shell.docks import Docks
from degense.app.shell.menus import Menus
from degense.app.shell.messages import Choice, ask, show_error
from degense.app.shell.panes import Panes
from degense.app.shell.settings import SettingsFile
from degense.app.shell.spare_memory import SpareMemory, giver
from degense.app.shell.status_bar import StatusBar
from degense.app.shell.worker import Job, Worker
from degense.engine.errors import DegenseError

TICK_MS = 1000
Service = TypeVar("Service")


class Shell(QMainWindow):
    """The window. It knows no feature: each installs itself through what this class offers."""

    complaint = Signal(str)  # (text) show an error; safe to emit from any thread
    ticked = Signal()  # every second
    dropped = Signal(object)  # (path) a file or folder was dropped into the window
    started = Signal()  # everything is installed
    leaving = Signal()  # the window is asked to close, before `may_close` is
    closed = Signal()  # it closes now

    def __init__(self, settings: SettingsFile, features: Sequence[Callable[[Shell], None]] = ()) -> None:
        super().__init__()
        self.settings = settings
        self.session = Session()
        self.worker = Worker(self)
        self.registry = ActionRegistry()
        self.docks, self.status = Docks(self), StatusBar(self)
        self.panes = Panes(self.docks)
        self.add_dock, self.add_actions, self.set_busy = self.docks.add, self.registry.add, self.status.set_busy
        self.worker.add_channel("export", 70)  # of all features that read or write files
        if (to_system := giver()) is not None:
            SpareMemory(self.worker, to_system)
        self.may_close: list[Callable[[Callable[[], object]], bool]] = []
        self._services: list[object] = []
        self.complaint.connect(self.show_error, Qt.ConnectionType.QueuedConnection)
        self._timer = QTimer(self)
        self._timer.timeout.connect(self.ticked)
        self._timer.start(TICK_MS)
        for install in features:
            install(self)
        self._add_drawer()
        self.menus = Menus(self.registry, self, self.complaint.emit)
        self._follow_session()
        self.docks.arrange()
        self.menus.list_panels(self.docks.switches.values())
        self.setAcceptDrops(True)
        self.resize(1440, 900)
        self._restore()
        self.started.emit()
        self._retitle()

    # What features use

    def refresh(self) -> None:
        """Bring titles, ticks and enabled states of all actions up to date."""
        if hasattr(self, "menus"):
            self.menus.refresh()

    def provide(self, service: object) -> None:
        """Offer an object to features that are installed later; they find it by its type."""
        self._services.append(service)

    def service(self, kind: type[Service]) -> Service | None:
        """What an installed feature provides, or None where that feature is left out."""
        return next((service for service in self._services if isinstance(service, kind)), None)

    def submit(
        self,
        channel: str,
        job: Job,
        done: Callable[[Any], None],
        failed: Callable[[str], None] | None = None,
        progress: Callable[[Any], None] | None = None,
    ) -> None:
        """Run a job in the worker (`Worker.submit`); what goes wrong is shown unless `failed` takes it."""
        self.worker.submit(channel, job, done, failed or self.show_error, progress)

    def run_task(
        self,
        channel: str,
        title: str,
        job: Job,
        done: Callable[[Any], object] | None = None,
        failed: Callable[[str], object] | None = None,
        *,
        detailed: bool = False,
        stop: Callable[[], object] | None = None,
    ) -> None:
        """Run a job whose steps are (fraction, what is being done), with its progress in the status bar and its errors in a dialog.

        The title, for example "Exporting liver.mp4", is shown while it runs, with what is being done if `detailed`. `done` takes the
        result; a DegenseError it raises is shown. By default the result is a sentence, which is shown. `failed` takes what went wrong.
        `stop` is called by a button beside the progress, which is shown where there is one.
        """

        def finished(result: Any) -> None:
            self.set_busy()
            self.attempt(lambda: (done or self.say)(result))
            self.refresh()

        def broken(message: str) -> None:
            self.set_busy()
            self.refresh()
            self.show_error(message)
            if failed is not None:
                failed(message)

        def progress(step: tuple[float, str]) -> None:
            self.set_busy(f"{title}: {step[1]}" if detailed else title, step[0], stop)

        self.set_busy(title, None, stop)
        self.worker.submit(channel, job, finished, broken, progress)

    def say(self, text: str, seconds: float = 8.0) -> None:
        """A line in the status bar, for some seconds."""
        self.statusBar().showMessage(text, round(seconds * 1000))

    def show_error(self, text: str) -> None:
        show_error(self, text)

    def ask(self, name: str, text: str, *choices: Choice, details: str = "", icon: QMessageBox.Icon = QMessageBox.Icon.Warning) -> None:
        """Ask a question; the window goes on meanwhile. See `messages.ask`."""
        ask(self, name, text, choices, details, icon)

    def attempt(self, act: Callable[[], object]) -> None:
        """Do it, and show in a dialog why when it cannot be done."""
        try:
            act()
        except DegenseError as error:
            self.show_error(str(error))

    def ask_folder(self, title: str, start: str = "") -> Path | None:
        """A folder that the user chooses; None when they cancel."""
        folder = QFileDialog.getExistingDirectory(self, title, start)
        return Path(folder) if folder else None

    def ask_open(self, title: str, start: str = "", kinds: str = "") -> Path | None:
        """A file to read; None when the user cancels. `kinds` as Qt's filters."""
        file, _ = QFileDialog.getOpenFileName(self, title, start, kinds)
        return Path(file) if file else None

    def ask_save(self, title: str, proposal: str, kinds: str = "") -> Path | None:
        """A file to write; None when the user cancels."""
        file, _ = QFileDialog.getSaveFileName(self, title, proposal, kinds)
        return Path(file) if file else None

    # The window itself

    def _add_drawer(self) -> None:
        """A button for each panel of the drawer, the action that opens and closes it, and those that go from one part to the next."""
        docks, menu, step = self.docks, ("View",), self.panes.step
        self.add_actions(
            Action("view.next-part", "Next part of the window", lambda: step(1), menu, ("F6",), group=1, help="focus panel keyboard"),
            Action("view.previous-part", "Previous part of the window", lambda: step(-1), menu, ("Shift+F6",), group=1, help="focus panel"),
        )
        for dock in docks.drawer:
            self.status.add_button(docks.switches[dock])
        if docks.drawer:
            toggle, shown = docks.toggle_drawer, docks.drawer_is_open
            self.add_actions(Action("view.drawer", "Drawer", toggle, menu, ("Ctrl+J",), checked=shown, group=1, help="panels bottom"))

    def _follow_session(self) -> None:
        session = self.session
        for signal in (session.opened, session.undo.changed):
            signal.connect(self._retitle)
        session.dirty_changed.connect(lambda dirty: self._retitle())
        for changed in (session.playing_changed, session.camera_mode_changed, session.probe_changed):
            changed.connect(lambda value: self.refresh())

    def _retitle(self) -> None:
        self.setWindowTitle(f"{self.session.name}[*] – DeGense" if self.session.name else "DeGense[*]")
        self.setWindowModified(self.session.dirty)
        undo = self.session.undo
        self.menus.name_undo(undo.undo_name, undo.redo_name)
        self.refresh()

    def _restore(self) -> None:
        settings = self.settings.value
        if settings.geometry:
            self.restoreGeometry(QByteArray.fromBase64(settings.geometry.encode("ascii")))
        if settings.state:
            self.docks.restore(settings.state)

    def event(self, event: QEvent) -> bool:
        """What the mouse does where it is stands in the status bar, under messages."""
        if isinstance(event, QStatusTipEvent):
            self.status.hint.setText(event.tip())
            return True
        return super().event(event)

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if _dropped_path(event) is not None:
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        if (path := _dropped_path(event)) is not None:
            event.acceptProposedAction()
            self.dropped.emit(path)

    def closeEvent(self, event: QCloseEvent) -> None:
        self.session.pause()
        self.leaving.emit()
        if not all(may(self.close) for may in self.may_close):
            event.ignore()
            return
        self._timer.stop()
        self.closed.emit()
        self.session.store.close()
        geometry = bytes(self.saveGeometry().toBase64().data()).decode("ascii")
        self.settings.update(geometry=geometry, state=self.docks.state())
        self.worker.close()
        super().closeEvent(event)


def _dropped_path(event: QDropEvent) -> Path | None:
    """The file or folder in a drop; None when there is not exactly one."""
    paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
    return paths[0] if len(paths) == 1 else None
