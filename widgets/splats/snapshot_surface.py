"""Splats on the screen as snapshots that are rendered elsewhere, for machines without a GPU."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QObject, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QImage, QPainter
from PySide6.QtWidgets import QWidget

from degense.engine.camera import Camera
from degense.widgets.forms import PaintedWidget
from degense.widgets.qt_images import rgb, to_array, to_qimage
from degense.widgets.splats.camera_moves import letterboxed
from degense.widgets.splats.gaussians import Gaussians

#: A snapshot that is requested so soon after the last one is rendered coarsely, and again finely when nothing changes for so long (ms).
REST_MS = 120

#: Screen pixels a side of a pixel of a coarse snapshot.
COARSE = 2


class SnapshotRequest(NamedTuple):
    """Gaussians with their colours (uint8 [N, 3]), to be rendered through a camera over a background (0 to 255)."""

    gaussians: Gaussians
    colours: np.ndarray
    camera: Camera
    background: tuple[int, int, int]


SnapshotDrawer = Callable[[SnapshotRequest], np.ndarray]


class SnapshotSurface(QObject):
    """A `Surface` that requests a snapshot whenever something has changed, and shows the last one until it comes.

    OpenGL on the processor would block the window: splats take it some hundred milliseconds, and with an OpenGL widget in it the whole
    window is composed by OpenGL at every painting.

    Signals
    -------
    wanted()
        A snapshot of `request` should be rendered and given to `take`.
    """

    wanted = Signal()

    def __init__(self, parent: QWidget, draw: SnapshotDrawer) -> None:
        super().__init__(parent)
        self.widget = _SnapshotWidget(parent)
        self._draw = draw
        self._gaussians: Gaussians | None = None
        self._colours = np.zeros((0, 3), np.uint8)
        self._camera: Camera | None = None
        self._background = QColor()
        self._rest = QTimer(self, singleShot=True, interval=REST_MS)
        self._rest.timeout.connect(self._refine)
        self._coarse = False

    def set_splats(self, gaussians: Gaussians, colours: np.ndarray) -> None:
        self._gaussians, self._colours = gaussians, colours

    def set_colours(self, colours: np.ndarray, opacities: np.ndarray) -> None:
        assert self._gaussians is not None
        self._gaussians, self._colours = self._gaussians._replace(opacities=opacities), colours
        self._ask()

    def set_background(self, colour: QColor) -> None:
        self._background = colour
        self.widget.set_background(colour)
        self._ask()

    def set_camera(self, camera: Camera, lowpass_scale: float, moving: bool) -> None:
        self._camera = camera
        self._ask()

    def request(self) -> SnapshotRequest | None:
        """What is to be rendered now; None without splats."""
        request = self._request()
        self._coarse = self._rest.isActive()
        if request is None or not self._coarse:
            return request
        camera = request.camera
        return request._replace(camera=letterboxed(camera, max(1, camera.width // COARSE), max(1, camera.height // COARSE)))

    def take(self, rgb: np.ndarray) -> None:
        """Show a snapshot of `request`, uint8 [H, W, 3]."""
        self.widget.show_image(rgb)
        self._rest.start()

    def grab(self) -> np.ndarray:
        request = self._request()
        return to_array(self.widget.grab().toImage()) if request is None else self._draw(request)

    def _request(self) -> SnapshotRequest | None:
        if self._gaussians is None or self._camera is None:
            return None
        return SnapshotRequest(self._gaussians, self._colours, self._camera, rgb(self._background))

    def _ask(self) -> None:
        if self._request() is not None:
            self.wanted.emit()

    def _refine(self) -> None:
        if self._coarse:
            self._ask()


class _SnapshotWidget(PaintedWidget):
    """An image, stretched to the widget; a plain colour until there is one."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._image = QImage()
        self._background = QColor()

    def show_image(self, rgb: np.ndarray) -> None:
        """Show uint8 [H, W, 3]."""
        self._image = to_qimage(rgb)
        self.update()

    def set_background(self, colour: QColor) -> None:
        self._background = colour
        self.update()

    def _paint(self, painter: QPainter) -> None:
        if self._image.isNull():
            painter.fillRect(self.rect(), self._background)
        else:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(self.rect(), self._image)
