"""The 3D view: sorted anisotropic splats on the screen, the surgeon's camera, a free camera, and picking."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QPointF, Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QResizeEvent
from PySide6.QtWidgets import QLabel, QVBoxLayout, QWidget

from degense.widgets.keys import ARROWS, keep_keys
from degense.widgets.qt_images import rgb
from degense.widgets.splats.camera_moves import splat_at
from degense.widgets.splats.gaussians import Gaussians, highlighted, tamed
from degense.widgets.splats.snapshot_surface import SnapshotDrawer, SnapshotRequest, SnapshotSurface
from degense.widgets.splats.splat_camera import CameraMouse, SplatCamera
from degense.widgets.theme import frame_background

if TYPE_CHECKING:
    from degense.widgets.splats.vtk_surface import VtkSurface


class SplatView(QWidget):
    """Splats seen by a camera.

    Locked, it shows the surgeon's view exactly as the 2D view does when fitted; a drag unlocks the camera.

    Parameters
    ----------
    draw : SnapshotDrawer, optional
        For machines without a GPU: the owner renders snapshots elsewhere. `snapshot_wanted` requests one, `snapshot_request` says of what,
        and `show_snapshot` shows it; `draw` renders one at once, for screenshots. Without it VTK draws.

    Signals
    -------
    picked(index)
        Of the clicked splat, −1 for none.
    """

    picked = Signal(int)
    snapshot_wanted = Signal()

    def __init__(self, parent: QWidget | None = None, draw: SnapshotDrawer | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("3D view")
        self.setMinimumSize(160, 120)
        self._snapshots: SnapshotSurface | None = None
        if draw is None:
            from degense.widgets.splats.vtk_surface import VtkSurface  # takes a second to load

            self._surface: VtkSurface | SnapshotSurface = VtkSurface(self)
            self._canvas = self._surface.widget
        else:
            self._surface = self._canvas = self._snapshots = SnapshotSurface(self, draw)
            self._snapshots.wanted.connect(self.snapshot_wanted)
        self._canvas.setAccessibleName("Splats")
        self._canvas.setAcceptDrops(False)
        keep_keys(self._canvas, ARROWS | {Qt.Key.Key_R, Qt.Key.Key_Plus, Qt.Key.Key_Minus, Qt.Key.Key_Equal})
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
        self._closed = False
        self.camera = SplatCamera(self._canvas)
        self.camera.changed.connect(self._apply_camera)
        self._mouse = CameraMouse(self._canvas, self.camera)
        self._mouse.clicked.connect(self._clicked)
        self._paint_background()

    def set_splats(self, means: np.ndarray, quats: np.ndarray, scales: np.ndarray, opacities: np.ndarray, colours: np.ndarray) -> None:
        """Show other splats (arrays as in `tamed`; colours [N, 3], uint8 or float in [0, 1]).

        The camera stays; the highlight stays as long as the number of splats does.
        """
        if self._closed:
            return
        if self._gaussians is None or len(means) != len(self._gaussians.means):
            self._highlight = None
        self._gaussians = tamed(means, quats, scales, opacities, colours)
        self._shown, self.camera.means = highlighted(self._gaussians, self._highlight), self._gaussians.means
        self._apply_camera()

    def highlight(self, indices: np.ndarray | None) -> None:
        """Mark some splats in magenta and make them opaque enough to be seen; None or an empty array clears."""
        marked = None if indices is None or len(indices) == 0 else np.asarray(indices, np.int64)
        if marked is None and self._highlight is None:
            return
        self._highlight = marked
        if self._gaussians is not None:
            self._shown = highlighted(self._gaussians, marked)
            self._apply_camera()

    def snapshot_request(self) -> SnapshotRequest | None:
        """What is to be rendered now; None when there is nothing, or VTK draws."""
        return self._snapshots.request() if self._snapshots is not None and not self._closed else None

    def show_snapshot(self, image: np.ndarray) -> None:
        """Show a render of `snapshot_request`, uint8 [H, W, 3]."""
        if self._snapshots is not None and not self._closed:
            self._snapshots.take(image)

    def screenshot_image(self) -> np.ndarray:
        """What is on the screen, uint8 [H, W, 3] in device pixels."""
        self.camera.rest()
        return self._surface.grab_image()

    def pick(self, x: float, y: float) -> int:
        """Index of the splat that one sees at a position in the widget (logical pixels), −1 for none."""
        if self._gaussians is None:
            return -1
        ratio = self._canvas.devicePixelRatioF()
        return splat_at(x * ratio, y * ratio, self.camera.viewport(), *self._gaussians[:4])

    def _clicked(self, position: QPointF) -> None:
        self.picked.emit(self.pick(position.x(), position.y()))

    def _apply_camera(self) -> None:
        if self._closed:
            return
        self._note.setText(self.camera.note())
        self._note.adjustSize()
        self._note.setVisible(self._gaussians is not None)
        if self._shown is not None:
            wanted = SnapshotRequest(self._shown, self.camera.viewport(), rgb(frame_background(self.palette())))
            self._surface.show_splats(wanted, self.camera.lowpass_scale(), self.camera.is_moving())

    def _paint_background(self) -> None:
        self._surface.set_background(frame_background(self.palette()))
        self._apply_camera()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        QTimer.singleShot(0, self, self._apply_camera)

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and not self._closed:
            self._paint_background()

    def closeEvent(self, event: QCloseEvent) -> None:
        """Give VTK's window back while its OpenGL context still lives."""
        if not self._closed:
            self._closed = True
            self.camera.stop()
            self._canvas.removeEventFilter(self._mouse)
            self._canvas.close()
        super().closeEvent(event)
