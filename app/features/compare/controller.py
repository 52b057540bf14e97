"""A second run beside the first: one camera, one instant, one layer, one range of colours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QTimer

from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.view_rendering import View, ViewRequest, draw_shown
from degense.engine.errors import RunError
from degense.widgets.frame.render_panel import RenderPanel

if TYPE_CHECKING:
    from degense.engine.scene import Scene


class RunComparison(QObject):
    """Draws what the session shows from another run into a panel of its own, right of the frame; both panels zoom and pan as one."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session, self.worker = viewer, viewer.shell, viewer.session, viewer.worker
        session = self.session
        self.scene: Scene | None = None  # the other run
        self.view: View | None = None  # what is shown of it
        self.panel = RenderPanel()
        self.panel.setAccessibleName("Frame of the other run")
        self.panel.hide()
        self.shell.docks.views.addWidget(self.panel)
        viewer.panel.zoom.changed.connect(lambda zoom: self._follow_zoom(viewer.panel, self.panel))
        self.panel.zoom.changed.connect(lambda zoom: self._follow_zoom(self.panel, viewer.panel))
        self.panel.clicked.connect(viewer.panel.clicked)
        viewer.shown.connect(self._draw)
        session.opened.connect(self.close)

    def ask(self) -> None:
        if (folder := self.shell.ask_folder("Compare with run", self.shell.settings.value.last_folder)) is not None:
            self.open(folder)

    def open(self, path: Path) -> None:
        """Load a run folder in the worker and show it beside the present one."""
        first = self.session.scene
        assert first is not None

        def load() -> Scene:
            from degense.engine.scene import Scene

            second = Scene.open(path)
            if (second.frames, second.clip_size) != (first.frames, first.clip_size):
                frames, (width, height) = second.frames, second.clip_size
                raise RunError(f"{path} shows another clip ({frames} frames, {width} × {height}); choose a run of the same one.")
            return second

        self.shell.run_task("second", f"Opening {path.name}", load, self._opened)

    def _opened(self, scene: Scene) -> None:
        assert self.session.scene is not None
        self.scene = scene
        self.viewer.panel.marks.set_title(self.session.scene.name)
        self.panel.marks.set_title(scene.name)
        self.panel.set_message(f"Drawing {scene.name} …")
        self.panel.show()
        share = self.shell.docks.views.width() // 3
        self.shell.docks.views.setSizes([share] * self.shell.docks.views.count())
        self.viewer.from_free_camera = True
        self.viewer.request()
        self.shell.refresh()
        QTimer.singleShot(0, self.panel, lambda: self._follow_zoom(self.viewer.panel, self.panel))

    def close(self) -> None:
        """Show one run again."""
        self.worker.cancel("second")
        self.worker.cancel("second-view")
        if self.scene is None:
            return
        self.scene = self.view = None
        self.viewer.from_free_camera = False
        self.panel.hide()
        self.panel.set_image(None)
        self.viewer.panel.marks.set_title("")
        self.viewer.request()
        self.shell.refresh()

    def _draw(self, first: View) -> None:
        """Draw the other run as the first one was drawn: the same instant, camera and colours."""
        scene, view_state = self.scene, self.session.view_state
        if scene is None:
            return
        camera = first.camera if self.viewer.free_camera() is not None else None
        wanted = ViewRequest(first.frame, view_state, first.spans, splats=False, quick=self.viewer.pacing.quick, camera=camera)
        self.worker.submit("second-view", lambda: draw_shown(scene, wanted), self._show, self._failed, self._show)

    def _show(self, view: View) -> None:
        self.view = view
        self.viewer.fill(self.panel, view)

    def _failed(self, message: str) -> None:
        self.view = None
        self.panel.set_image(None)
        self.panel.set_message(message)

    def _follow_zoom(self, leader: RenderPanel, follower: RenderPanel) -> None:
        if self.scene is not None and follower.isVisible():
            follower.zoom.set_view(*leader.zoom.view(), leader.zoom.fitted)
