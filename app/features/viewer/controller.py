"""The 2D and the 3D view: the latest request of the session is rendered, and both views show it together."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QKeyEvent

from degense.app.features.timeline.controller import TimeControl
from degense.app.features.viewer.layer_images import get_layer
from degense.app.features.viewer.pacing import Pacing
from degense.app.features.viewer.sequence_ranges import SequenceRanges
from degense.app.features.viewer.view_bar import ViewBar
from degense.app.features.viewer.view_rendering import (
    EXCLUDED,
    View,
    ViewRequest,
    draw_clip,
    draw_shown,
    draw_snapshot,
)
from degense.engine.camera import Camera
from degense.engine.colour_maps import UNKNOWN
from degense.engine.layer_titles import with_unit
from degense.widgets.frame.render_panel import RenderPanel
from degense.widgets.theme import BACKGROUNDS

if TYPE_CHECKING:
    from degense.app.shell.shell import Shell
    from degense.widgets.splats.gaussians import Gaussians
    from degense.widgets.splats.splat_view import SplatView

WELCOME = "Drop a clip or a run here, or open one from the File menu.\nFile ▸ Demo shows a finished scene."
DRAWING = "Drawing the first frame …\nThe first start after installing takes up to a minute."


class Viewer(QObject):
    """Requests what the session shows from the worker, and shows the result in both views."""

    shown = Signal(object)  # (View) both views show all of it
    drawn = Signal(object)  # (View) the 2D view shows it, perhaps without its masks yet
    splats_added = Signal(object)  # (SplatView) the 3D view is there

    def __init__(self, shell: Shell) -> None:
        super().__init__(shell)
        self.shell, self.session, self.worker = shell, shell.session, shell.worker
        session = self.session
        self._time = shell.service(TimeControl)
        self.panel = RenderPanel()  # the 2D view
        self.panel.set_message(WELCOME)
        self.panel.tool_chosen.connect(shell.statusBar().clearMessage)  # which would hide what the tool wants
        #: The 3D view. It comes once the window is on the screen.
        self.splats: SplatView | None = None
        self.bar = ViewBar(self.panel)  # of the colours in both views
        _LayerDigits(self.panel)
        shell.docks.views.addWidget(self.panel)
        shell.installEventFilter(self)
        self.view: View | None = None  # what is shown
        self._splats: Gaussians | None = None  # that the 3D view has
        self.milliseconds: deque[float] = deque(maxlen=200)
        self.pacing = Pacing(self.worker, self._submit, self)
        self._ranges = SequenceRanges(shell, self.request, self._failed)
        self._camera: Camera | None = None
        self._asked = 0.0
        self.from_free_camera = False  # whether the 2D view is rendered from the free camera of the 3D view, and not from the surgeon's
        #: Gives what reads the labels of a frame, while the 2D view shows recorded frames, to which labels belong.
        self.labels: Callable[[int], Callable[[], object]] | None = None
        session.opened.connect(self._opened)
        session.frame_changed.connect(lambda frame: self.request())
        session.view_state_changed.connect(lambda before, after: self.request())
        session.playing_changed.connect(self._playing_changed)
        session.camera_mode_changed.connect(lambda mode: self._aim(force=True))

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Show and self.splats is None:
            QTimer.singleShot(0, self._start_splat_view)
        return False

    def _start_splat_view(self, channel: str = "") -> None:
        """Add the 3D view at once, or after the first frame when something is being opened."""
        if self.splats is not None or not self.shell.isVisible():
            return
        if self.worker.busy("open") or self.worker.busy("view"):
            self.worker.freed.connect(self._start_splat_view, Qt.ConnectionType.SingleShotConnection)
        elif channel:
            QTimer.singleShot(20, self._start_splat_view)  # after the frame has been painted
        else:
            self.add_splat_view()

    def add_splat_view(self) -> None:
        """Put the 3D view at the left of the 2D view."""
        from degense.widgets.splats.splat_view import SplatView

        views = self.shell.docks.views
        self.splats = splats = SplatView(draw_snapshot)
        self.set_background()
        views.insertWidget(0, splats)
        views.setStretchFactor(0, 1)
        views.setStretchFactor(1, 1)
        views.setSizes([1000, 1000])
        splats.camera.locked_changed.connect(self._locked_changed)
        splats.camera.moved.connect(self._camera_moved)
        splats.snapshot_wanted.connect(self._draw_snapshot)
        splats.setVisible(self.session.scene is not None)
        self.shell.closed.connect(splats.close)
        self.splats_added.emit(splats)
        self.request()
        self.shell.refresh()

    def set_background(self) -> None:
        """Give the 3D view the background of the settings."""
        if self.splats is not None:
            self.splats.set_background(QColor(BACKGROUNDS[self.shell.settings.value.background]))

    def set_message(self, text: str) -> None:
        """Show a text in the 2D view while nothing is open."""
        if self.session.frames == 0:
            self.panel.set_message(text)

    def request(self) -> None:
        """Draw what the session shows now."""
        self.pacing.request(self.session.playing)

    def _submit(self, quick: bool) -> None:
        session = self.session
        self._asked = time.perf_counter()
        labels = self.labels(session.frame) if self.labels is not None else None
        if session.scene is not None:
            scene, view_state = session.scene, session.view_state
            splats = self.splats is not None and not self.splats.isHidden()
            wanted = ViewRequest(
                session.frame,
                view_state,
                self._ranges.ranges(scene, view_state),
                splats,
                quick,
                self.free_camera(),
                labels,
            )
            self.worker.submit("view", lambda: draw_shown(scene, wanted), self._show, self._failed, progress=self._show)
        elif session.clip is not None:
            clip, frame = session.clip, session.frame
            self.worker.submit("view", lambda: draw_clip(clip, frame, labels), self._show, self._failed)
        else:
            self.worker.cancel("view")

    def _playing_changed(self, playing: bool) -> None:
        if not playing:
            self.pacing.draw_exactly()

    def _opened(self) -> None:
        self._ranges.clear()
        self.view = self._camera = self._splats = None
        self.panel.set_overlay(None)
        self.panel.comparison.set_observed(None)
        self.panel.marks.set_marker(None)
        if self.splats is not None:
            self.splats.setVisible(self.session.scene is not None)
        self.panel.set_message(DRAWING if self.session.frames > 0 else WELCOME)
        if self.session.frames == 0:
            self.panel.set_image(None)
        self.pacing.draw_exactly()

    # Results

    def _show(self, view: View) -> None:
        same_frame = self.view is not None and self.view.frame == view.frame
        if self.view is not None and same_frame and not view.complete and np.array_equal(view.rgb, self.view.rgb):
            return  # nothing new before the masks
        self.view = view
        self.fill(self.panel, view, keep_overlay=same_frame)
        self.drawn.emit(view)
        self._show_bar(view)
        if view.notice:
            self.shell.say(view.notice, 20)
        if view.complete:
            self.panel.repaint()  # at once: all that follows from it can wait
        # A changed view state waits for its masks: the 3D view would be drawn twice, and the worker would do it before them.
        arrays = view.splats if view.complete or not same_frame else None
        if arrays is not None and arrays is not self._splats and self.splats is not None:
            self._splats = arrays
            self.splats.set_splats(*arrays)
            self._aim()
        if view.complete:
            self._frame_drawn()
            self.milliseconds.append(1000 * (time.perf_counter() - self._asked))
            self.shown.emit(view)

    def _frame_drawn(self) -> None:
        """While time runs the timeline waits for each frame."""
        if self._time is not None:
            self._time.timeline.frame_drawn()

    def fill(self, panel: RenderPanel, view: View, keep_overlay: bool = False) -> None:
        """Show a view in a panel: frame, masks, observed frame and legend.

        With `keep_overlay` the masks that are shown stay until the new ones are known.
        """
        view_state = self.session.view_state
        panel.set_image(view.rgb)
        if view.complete or not keep_overlay:
            panel.set_overlay(view.masks)
        panel.set_overlay_opacity(view_state.overlay_opacity)
        panel.comparison.set_observed(view.observed)
        panel.comparison.set_mode(view_state.compare)
        shown = view_state.visible_prompts if view.masks is not None or view_state.layer == "mask" else ()
        legend = [(prompt.text, QColor(*prompt.colour)) for prompt in shown]
        if self.session.scene is None and view.masks is not None:
            legend = [("left out: instrument or outside the field of view", QColor(*EXCLUDED))]
        if view.uncertain:
            legend.append((view.uncertain, QColor(*UNKNOWN)))
        panel.marks.set_legend(legend)

    def _show_bar(self, view: View) -> None:
        title = get_layer(view.layer).title
        if view.span is None:
            self.bar.hide()
        else:
            self.bar.show_range(with_unit(title, view.unit), *view.span, view.cmap, view.beyond)

    def _failed(self, message: str) -> None:
        self.view = None
        self.bar.hide()
        self.panel.set_image(None)
        self.panel.set_overlay(None)
        self.panel.set_message(message)
        self._frame_drawn()

    # The 3D camera

    def _aim(self, force: bool = False) -> None:
        """Lock the 3D view to the surgeon's camera of this frame, or free it, as the session says."""
        splats, scene = self.splats, self.session.scene
        if splats is None or scene is None:
            return
        camera = scene.camera(self.session.frame)
        if self.session.camera_mode == "surgeon":
            if camera is not self._camera or force or not splats.camera.is_locked():
                splats.camera.lock(camera)
                self._camera = camera
        elif splats.camera.is_locked():
            splats.camera.set_free(splats.camera.current())

    def toggle_free_camera(self) -> None:
        self.session.camera_mode = "free" if self.session.camera_mode == "surgeon" else "surgeon"

    def free_camera(self) -> Camera | None:
        """The free camera of the 3D view, at the clip's size, when the 2D view is to be rendered from there too."""
        splats, scene = self.splats, self.session.scene
        if self.labels is not None or not self.from_free_camera or splats is None or scene is None or splats.camera.is_locked():
            return None
        return splats.camera.current().filled(*scene.clip_size)

    def is_surgeons(self) -> bool:
        """Whether the 2D view is rendered from the surgeon's camera, and a word where it is not; places are chosen in no other."""
        if self.free_camera() is not None:
            self.shell.say("Go back to the surgeon's view (V) to choose a place.")
            return False
        return True

    def _camera_moved(self, camera: Camera) -> None:
        if self.from_free_camera:
            self.request()

    def _draw_snapshot(self) -> None:
        """Render the 3D view in the worker."""
        splats = self.splats
        request = splats.snapshot_request() if splats is not None else None
        if splats is not None and request is not None:
            self.worker.submit("snapshot", lambda: draw_snapshot(request), splats.show_snapshot, self.shell.say)

    def _locked_changed(self, locked: bool) -> None:
        self.session.camera_mode = "surgeon" if locked else "free"


class _LayerDigits(QObject):
    """Leaves the key 1 to the layers, also while the 2D view has the focus (there it would zoom to 100 %)."""

    def __init__(self, panel: RenderPanel) -> None:
        super().__init__(panel)
        panel.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.ShortcutOverride and isinstance(event, QKeyEvent) and event.key() == Qt.Key.Key_1:
            event.ignore()
            return True
        return False
