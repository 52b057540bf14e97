"""The 3D view: splats on the screen, guides over them, the surgeon's camera, a free camera, and picking."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QColor, QResizeEvent
from PySide6.QtWidgets import QLabel, QVBoxLayout, QWidget

from degense.widgets.keys import keep_keys
from degense.widgets.qt_images import rgb
from degense.widgets.splats.camera_moves import splat_at
from degense.widgets.splats.gaussians import Gaussians, highlighted, tamed, visible
from degense.widgets.splats.guides import Guide
from degense.widgets.splats.snapshot_surface import SnapshotDrawer, SnapshotRequest, SnapshotSurface
from degense.widgets.splats.splat_camera import CameraMouse, SplatCamera


class SplatView(QWidget):
    """Splats seen by a camera.

    Locked, it shows what the surgeon's camera sees; a drag unlocks the camera. The wheel with Ctrl cuts away what is near.

    `draw` renders a snapshot at once, for screenshots. Otherwise the owner renders them elsewhere: `snapshot_wanted` requests one,
    `snapshot_request` says of what, and `show_snapshot` shows it.
    """

    picked = Signal(int)  # (index) of the clicked splat, −1 for none
    snapshot_wanted = Signal()

    def __init__(self, draw: SnapshotDrawer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("3D view")
        self.setMinimumSize(160, 120)
        self._canvas = SnapshotSurface(self, draw)
        self._canvas.wanted.connect(self.snapshot_wanted)
        self._canvas.setAccessibleName("Splats")
        self._canvas.setStatusTip("Click: follow this place · drag: turn · Shift and drag: move · wheel: closer · Ctrl and wheel: cut open")
        keep_keys(self._canvas, {Qt.Key.Key_Plus, Qt.Key.Key_Minus, Qt.Key.Key_Equal})
        self.setFocusProxy(self._canvas)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._canvas)
        self._note = QLabel(self)
        self._note.setObjectName("viewNote")
        self._note.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._note.move(8, 8)
        self._gaussians: Gaussians | None = None
        self._shown: Gaussians | None = None  # with the highlight
        self._highlight: np.ndarray | None = None
        self._guides: Sequence[Guide] = ()
        self._background = QColor("black")
        self._closed = False
        self.camera = SplatCamera(self._canvas)
        self.camera.changed.connect(self._request)
        self._mouse = CameraMouse(self._canvas, self.camera)
        self._mouse.clicked.connect(self._clicked)
        self._mouse.cut.connect(self.cut)
        self._cut = 0.0  # share of the distance to the middle of the scene that is cut away

    def set_splats(self, means: np.ndarray, quats: np.ndarray, scales: np.ndarray, opacities: np.ndarray, colours: np.ndarray) -> None:
        """Show other splats (arrays as in `tamed`; colours [N, 3], uint8 or float where 1 is full).

        The camera stays; the highlight stays as long as the number of splats does.
        """
        if self._gaussians is None or len(means) != len(self._gaussians.means):
            self._highlight = None
        self._gaussians = tamed(means, quats, scales, opacities, colours)
        self._shown, self.camera.means = highlighted(self._gaussians, self._highlight), means[visible(self._gaussians)]
        self._request()

    def set_guides(self, guides: Sequence[Guide]) -> None:
        """Lay other lines over the splats; they are hidden where splats lie before them."""
        if guides or self._guides:
            self._guides = guides
            self._request()

    def set_background(self, colour: QColor) -> None:
        self._background = colour
        self._canvas.set_background(colour)
        self._request()

    def highlight(self, indices: np.ndarray | None) -> None:
        """Mark some splats in magenta and make them opaque enough to be seen; None or an empty array clears."""
        marked = None if indices is None or len(indices) == 0 else np.asarray(indices, np.int64)
        if marked is None and self._highlight is None:
            return
        self._highlight = marked
        if self._gaussians is not None:
            self._shown = highlighted(self._gaussians, marked)
            self._request()

    def snapshot_request(self) -> SnapshotRequest | None:
        """What is to be rendered now; None when there is nothing."""
        return None if self._closed else self._canvas.request()

    def show_snapshot(self, image: np.ndarray) -> None:
        """Show a render of `snapshot_request`, uint8 [H, W, 3]."""
        if not self._closed:
            self._canvas.take(image)

    def screenshot_image(self) -> np.ndarray:
        """What is on the screen when nothing moves, uint8 [H, W, 3] in device pixels."""
        self._request()
        return self._canvas.grab_image()

    def pick(self, x: float, y: float) -> int:
        """Index of the splat that one sees at a position in the widget (logical pixels), −1 for none."""
        if self._shown is None:
            return -1
        ratio = self._canvas.devicePixelRatioF()
        return splat_at(x * ratio, y * ratio, self.camera.viewport(), *self._left_over(self._shown)[:4])

    def _clicked(self, position: QPointF) -> None:
        self.picked.emit(self.pick(position.x(), position.y()))

    def cut(self, step: float) -> None:
        """Cut more of what is near away, or less: `step` is a share of the distance to the middle of the scene."""
        self._cut = max(0.0, self._cut + step)
        self._request()

    def uncut(self) -> None:
        """Cut nothing away."""
        self.cut(-self._cut)

    def _left_over(self, gaussians: Gaussians) -> Gaussians:
        """The Gaussians behind the cut."""
        if not self._cut:
            return gaussians
        camera = self.camera.viewport()
        behind = camera.project(gaussians.means)[1] >= self._cut * camera.project(self.camera.pivot())[1]
        return gaussians._replace(opacities=np.where(behind, gaussians.opacities, np.float32(0.0)))

    def _request(self) -> None:
        if self._closed:
            return
        self._note.setText(self.camera.note() + (f" – cut open at {self._cut:.0%}" if self._cut else ""))
        self._note.adjustSize()
        self._note.setVisible(self._gaussians is not None)
        if self._shown is not None:
            left = self._left_over(self._shown)
            self._canvas.show_splats(SnapshotRequest(left, self.camera.viewport(), rgb(self._background), self._guides))

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        QTimer.singleShot(0, self, self._request)

    def closeEvent(self, event: QCloseEvent) -> None:
        self._closed = True
        super().closeEvent(event)
