"""Splats on the screen as pictures that are drawn elsewhere, for machines without a GPU."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QObject, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QWidget

from degense.engine.camera import Camera
from degense.widgets.frame.images import to_array, to_qimage
from degense.widgets.splats.camera_moves import letterboxed
from degense.widgets.splats.gaussians import Gaussians

#: A picture that is asked for so soon after the last one is drawn coarsely, and again finely when nothing changes for so long (ms).
REST_MS = 120

#: Screen pixels a side of a pixel of a coarse picture.
COARSE = 2


class StillRequest(NamedTuple):
    """What is to be drawn: Gaussians with their colours (uint8 [N, 3]) through a camera, over a colour."""

    gaussians: Gaussians
    colours: np.ndarray
    camera: Camera
    background: tuple[int, int, int]


StillDrawer = Callable[[StillRequest], np.ndarray]


class StillSurface(QObject):
    """Asks for a picture whenever something has changed, and shows the last one until it comes.

    OpenGL on the processor would hold up the window: not only do splats take it some hundred milliseconds; with an OpenGL widget in it the
    whole window is put together by OpenGL at every painting.

    Signals
    -------
    wanted()
        A picture of `request` should be drawn and given to `take`.

    Attributes
    ----------
    widget : QWidget
        What is on the screen.
    """

    wanted = Signal()

    def __init__(self, parent: QWidget, draw: StillDrawer) -> None:
        super().__init__(parent)
        self.widget = StillPicture(parent)
        self._draw = draw
        self._gaussians: Gaussians | None = None
        self._colours = np.zeros((0, 3), np.uint8)
        self._camera: Camera | None = None
        self._background = QColor()
        self._rest = QTimer(self)
        self._rest.setSingleShot(True)
        self._rest.setInterval(REST_MS)
        self._rest.timeout.connect(self._refine)
        self._coarse = False

    def set_splats(self, gaussians: Gaussians, colours: np.ndarray) -> None:
        """Show other splats, colours uint8 [N, 3], from the next `view_state` on."""
        self._gaussians, self._colours = gaussians, colours

    def set_colours(self, colours: np.ndarray, opacities: np.ndarray) -> None:
        assert self._gaussians is not None
        self._gaussians, self._colours = self._gaussians._replace(opacities=opacities), colours
        self._ask()

    def set_background(self, colour: QColor) -> None:
        self._background = colour
        self.widget.set_background(colour)
        self._ask()

    def view_state(self, camera: Camera, lowpass_scale: float, moving: bool) -> None:
        """Look through a camera whose image fills the widget."""
        self._camera = camera
        self._ask()

    def request(self) -> StillRequest | None:
        """What is to be drawn now; None without splats."""
        request = self._request()
        self._coarse = self._rest.isActive()
        if request is None or not self._coarse:
            return request
        camera = request.camera
        return request._replace(camera=letterboxed(camera, max(1, camera.width // COARSE), max(1, camera.height // COARSE)))

    def take(self, rgb: np.ndarray) -> None:
        """Show a picture of `request`, uint8 [H, W, 3]."""
        self.widget.show_picture(rgb)
        self._rest.start()

    def picture(self) -> np.ndarray:
        """What is on the screen when nothing moves, uint8 [H, W, 3] in device pixels; drawn now."""
        request = self._request()
        return to_array(self.widget.grab().toImage()) if request is None else self._draw(request)

    def _request(self) -> StillRequest | None:
        if self._gaussians is None or self._camera is None:
            return None
        colour = self._background
        return StillRequest(self._gaussians, self._colours, self._camera, (colour.red(), colour.green(), colour.blue()))

    def _ask(self) -> None:
        if self._request() is not None:
            self.wanted.emit()

    def _refine(self) -> None:
        if self._coarse:
            self._ask()


class StillPicture(QWidget):
    """A picture, stretched to the widget; a plain colour until there is one."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self._image = QImage()
        self._background = QColor()

    def show_picture(self, rgb: np.ndarray) -> None:
        """Show uint8 [H, W, 3]."""
        self._image = to_qimage(rgb)
        self.update()

    def set_background(self, colour: QColor) -> None:
        self._background = colour
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        with QPainter(self) as painter:  # ended even when painting fails; Qt crashes on a painter left open
            if self._image.isNull():
                painter.fillRect(self.rect(), self._background)
            else:
                painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
                painter.drawImage(self.rect(), self._image)
