"""A second run beside the first: one camera, one instant, one layer, one range of colours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtWidgets import QFileDialog

from degense.app.features.viewer.controller import Drawing
from degense.app.features.viewer.view import View, ViewRequest, draw_view
from degense.app.session.session import Session
from degense.app.shell.messages import show_error
from degense.app.shell.parts import Parts
from degense.app.shell.settings import SettingsFile
from degense.app.shell.worker import RenderService
from degense.engine.errors import RunError
from degense.widgets.frame.render_panel import RenderPanel

if TYPE_CHECKING:
    from degense.engine.scene import Scene


class Runs(QObject):
    """Draws what the session shows from another run into a panel of its own, right of the picture; both panels zoom and pan as one.

    Attributes
    ----------
    scene : Scene or None
        The other run.
    view : View or None
        What is shown of it.

    Signals
    -------
    changed()
        Another run was put beside the first, or away.
    """

    changed = Signal()

    def __init__(self, session: Session, service: RenderService, settings: SettingsFile, parts: Parts, drawing: Drawing) -> None:
        super().__init__(parts)
        self.session, self.service, self.settings, self.parts, self.drawing = session, service, settings, parts, drawing
        self.scene: Scene | None = None
        self.view: View | None = None
        self.panel = RenderPanel()
        self.panel.setAccessibleName("Picture of the other run")
        self.panel.hide()
        parts.views.addWidget(self.panel)
        parts.panel.zoom_changed.connect(lambda zoom: self._look_alike(parts.panel, self.panel))
        self.panel.zoom_changed.connect(lambda zoom: self._look_alike(self.panel, parts.panel))
        self.panel.clicked.connect(parts.panel.clicked)
        drawing.shown.connect(self._draw)
        session.opened.connect(self.close)

    def ask(self) -> None:
        folder = QFileDialog.getExistingDirectory(self.parts.window, "Hold against another run", self.settings.value.last_folder)
        if folder:
            self.open(Path(folder))

    def open(self, path: Path) -> None:
        """Load a run folder in the worker and show it beside the present one."""
        first = self.session.scene
        assert first is not None
        self.parts.set_busy(f"Opening {path.name}")

        def load() -> Scene:
            from degense.engine.scene import Scene

            second = Scene.open(path)
            if (second.frames, second.clip_size) != (first.frames, first.clip_size):
                frames, (width, height) = second.frames, second.clip_size
                raise RunError(f"{path} shows another clip ({frames} frames, {width} × {height}); choose a run of the same one.")
            return second

        def failed(message: str) -> None:
            self.parts.set_busy()
            show_error(self.parts.window, message)

        self.service.submit("second", load, self._opened, failed)

    def _opened(self, scene: Scene) -> None:
        assert self.session.scene is not None
        self.parts.set_busy()
        self.scene = scene
        self.parts.panel.set_title(self.session.scene.name)
        self.panel.set_title(scene.name)
        self.panel.set_message(f"Drawing {scene.name} …")
        self.panel.show()
        share = self.parts.views.width() // 3
        self.parts.views.setSizes([share] * self.parts.views.count())
        self.drawing.from_free_camera = True
        self.drawing.request()
        self.changed.emit()
        QTimer.singleShot(0, self.panel, lambda: self._look_alike(self.parts.panel, self.panel))

    def close(self) -> None:
        """Show one run again."""
        self.service.cancel("second")
        self.service.cancel("second-view")
        if self.scene is None:
            return
        self.scene = self.view = None
        self.drawing.from_free_camera = False
        self.panel.hide()
        self.panel.set_image(None)
        self.parts.panel.set_title("")
        self.drawing.request()
        self.changed.emit()

    def _draw(self, first: View) -> None:
        """Draw the other run as the first one was drawn: the same instant, camera and colours."""
        scene, view_state = self.scene, self.session.view_state
        if scene is None:
            return
        camera = first.camera if self.drawing.free_camera() is not None else None
        wanted = ViewRequest(first.frame, view_state, first.span, splats=False, quick=self.session.playing, camera=camera)
        self.service.submit("second-view", lambda: draw_view(scene, wanted), self._show, self._failed, self._show)

    def _show(self, view: View) -> None:
        self.view = view
        self.drawing.fill(self.panel, view)

    def _failed(self, message: str) -> None:
        self.view = None
        self.panel.set_image(None)
        self.panel.set_message(message)

    def _look_alike(self, leader: RenderPanel, follower: RenderPanel) -> None:
        if self.scene is not None and follower.isVisible():
            follower.set_view(*leader.view())
