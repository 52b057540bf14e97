"""The main window: puts the pieces together, and nothing else."""

from __future__ import annotations

from PySide6.QtCore import QByteArray, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QDragEnterEvent, QDropEvent, QShowEvent
from PySide6.QtWidgets import QMainWindow

from degense.app.features.annotate.controller import Annotating
from degense.app.features.annotate.exchange import Handing
from degense.app.features.cameras.controller import Cameras
from degense.app.features.compare.controller import Runs
from degense.app.features.documents.autosave import Keeping
from degense.app.features.documents.opening import Opening
from degense.app.features.export.controller import Exporting
from degense.app.features.inspect.probe import Probing
from degense.app.features.inspect.ranking import RankingControl
from degense.app.features.prompts.clip_query import ClipQuerying
from degense.app.features.prompts.controller import Answering
from degense.app.features.runs.dialog import RunList
from degense.app.features.train.controller import Training
from degense.app.features.viewer.controller import Drawing
from degense.app.session.playback import Playback
from degense.app.session.session import Session
from degense.app.shell import window_actions as actions
from degense.app.shell.actions import ActionRegistry
from degense.app.shell.controls import Controls
from degense.app.shell.help import Helping
from degense.app.shell.layout import WindowLayout
from degense.app.shell.menus import Menus
from degense.app.shell.messages import show_error
from degense.app.shell.parts import Parts
from degense.app.shell.preferences import Preferring
from degense.app.shell.settings import SettingsFile
from degense.app.shell.worker import RenderService

#: The most urgent first.
CHANNELS = (
    "open",
    "check-picture",
    "check",
    "view",
    "still",
    "range",
    "answers",
    "material",
    "second",
    "second-view",
    "probe",
    "curves",
    "rank",
    "annotate",
    "observed",
    "export",
    "query",
    "areas",
    "doctor",
)


class MainWindow(QMainWindow):
    """Everything of one window.

    Signals
    -------
    complaint(text)
        Show an error; safe to emit from any thread.
    ready()
        The 3D view is there.
    """

    complaint = Signal(str)
    ready = Signal()

    def __init__(self, settings: SettingsFile) -> None:
        super().__init__()
        self.settings = settings
        self.session = Session()
        self.service = RenderService(CHANNELS, self)
        self.parts = Parts(self)
        self.playback = Playback()
        self.session.register("playback", self.playback)
        self.drawing = Drawing(self.session, self.service, self.parts)
        self.controls = Controls(self.session, settings, self.parts, self.playback)
        self.probing = Probing(self.session, self.service, self.parts, self.drawing)
        self.answering = Answering(self.session, self.service, self.parts, self.drawing)
        self.querying = ClipQuerying(self.session, self.service, self.parts, self.answering)
        self.ranking = RankingControl(self.session, self.service, self.parts, self.drawing)
        self.cameras = Cameras(self.session, self.service, self.parts, self.drawing)
        self.runs = Runs(self.session, self.service, settings, self.parts, self.drawing)
        self.keeping = Keeping(self.session, settings, self.parts)
        self.opening = Opening(self.session, self.service, settings, self.parts, self.keeping)
        self.exporting = Exporting(self.session, self.service, self.parts, self.drawing)
        self.training = Training(self.session, self.service, self.parts, self.opening)
        self.run_list = RunList(self.session, settings, self.parts, self.opening, self.training)
        self.session.register("window", WindowLayout(self.session, self.parts, self.drawing))
        self.annotating = Annotating(self.session, self.service, self.parts, self.drawing, lambda action: self.menus.run(action))
        self.handing = Handing(self.session, self.service, self.parts, self.training)
        self.registry = ActionRegistry()
        self.helping = Helping(self.registry, self.session, self.service, self.parts, self.complaint.emit)
        self.preferring = Preferring(self.registry, self.session, settings, self.parts)
        actions.fill(self.registry, self)
        self.preferring.take_shortcuts()
        self.menus = Menus(self.registry, self, self.complaint.emit)
        self.parts.annotation.follow(self.menus.actions)
        self.helping.run = self.menus.run
        self.preferring.shortcuts_changed.connect(self.menus.rebind)
        self.preferring.changed.connect(self.menus.refresh)
        self.menus.add_recent(settings, self.opening.open_path)
        docks = self.menus.menu(("View", "Panels"))
        for dock in self.parts.docks:
            docks.addAction(dock.toggleViewAction())
        self.complaint.connect(lambda text: show_error(self, text), Qt.ConnectionType.QueuedConnection)
        for signal in (self.session.opened, self.session.undo.changed):
            signal.connect(self._refresh)
        self.session.playing_changed.connect(lambda playing: self.menus.refresh())
        self.session.camera_mode_changed.connect(lambda mode: self.menus.refresh())
        self.session.dirty_changed.connect(lambda dirty: self._refresh())
        self.session.probe_changed.connect(lambda place: self.menus.refresh())
        self.training.changed.connect(self.menus.refresh)
        self.annotating.changed.connect(self.menus.refresh)
        self.probing.tool_changed.connect(self.menus.refresh)
        self.ranking.changed.connect(self.menus.refresh)
        self.querying.changed.connect(self.menus.refresh)
        self.runs.changed.connect(self.menus.refresh)
        self.cameras.changed.connect(self.menus.refresh)
        self.playback.changed.connect(lambda record: self.menus.refresh())
        self.parts.log.attach()
        self.setAcceptDrops(True)
        self.resize(1440, 900)
        self._restore()
        self.training.offer_kept()
        self._refresh()

    # What actions need

    def focus_prompt(self) -> None:
        self.parts.prompts_dock.show()
        self.parts.prompts_dock.raise_()
        self.parts.prompts.focus_input()

    def show_history(self) -> None:
        self.parts.history_dock.show()
        self.parts.history_dock.raise_()

    # Qt's own events

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        if self.parts.splats is None:
            QTimer.singleShot(0, self._start_splat_view)

    def _start_splat_view(self) -> None:
        """Add the 3D view at once, or after the first picture when something is being opened: loading VTK would hold that up."""
        if self.service.busy("open"):
            for signal in (self.drawing.shown, self.opening.failed):
                signal.connect(self._soon, Qt.ConnectionType.SingleShotConnection)
        else:
            self._add_splat_view()

    def _soon(self) -> None:
        QTimer.singleShot(20, self._add_splat_view)  # after the picture has been painted

    def _add_splat_view(self) -> None:
        if self.parts.splats is None and self.isVisible():
            self.parts.add_splat_view()
            self.drawing.use_splat_view()
            self.probing.use_splat_view()
            self.menus.refresh()
            self.ready.emit()

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if self.opening.dropped(event.mimeData()) is not None:
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        path = self.opening.dropped(event.mimeData())
        if path is not None:
            event.acceptProposedAction()
            self.opening.open_path(path)

    def closeEvent(self, event: QCloseEvent) -> None:
        self.session.pause()
        self.annotating.end()  # a stroke that has not ended is saved too
        if not (self.training.may_close(self.close) and self.keeping.may_leave(self.close)):
            event.ignore()
            return
        self.cameras.land()
        self.keeping.end()
        self.run_list.stop()
        geometry = bytes(self.saveGeometry().toBase64().data()).decode("ascii")
        state = bytes(self.saveState().toBase64().data()).decode("ascii")
        self.settings.update(geometry=geometry, state=state)
        self.service.close()
        self.parts.log.detach()
        if self.parts.splats is not None:
            self.parts.splats.close()
        super().closeEvent(event)

    def _restore(self) -> None:
        settings = self.settings.value
        if settings.geometry:
            self.restoreGeometry(QByteArray.fromBase64(settings.geometry.encode("ascii")))
        if settings.state:
            self.restoreState(QByteArray.fromBase64(settings.state.encode("ascii")))
            self.parts.monitor_dock.hide()

    def _refresh(self) -> None:
        """Title, undo names, and the states of all actions."""
        session = self.session
        self.setWindowTitle(f"{session.name}[*] – DeGense" if session.name else "DeGense[*]")
        self.setWindowModified(session.dirty)
        for action, name, verb in (("edit.undo", session.undo.undo_name, "Undo"), ("edit.redo", session.undo.redo_name, "Redo")):
            self.menus.actions[action].setText(f"{verb}: {name}" if name else verb)
        self.menus.refresh()
