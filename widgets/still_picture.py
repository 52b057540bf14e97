"""A picture of splats that was drawn elsewhere, laid over the view that would have drawn it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QWidget

from engine.camera import Camera
from widgets.images import to_qimage
from widgets.scene_painter import Gaussians


class StillRequest(NamedTuple):
    """What is to be drawn: Gaussians with their colours (uint8 [N, 3]) through a camera, over a colour."""

    gaussians: Gaussians
    colours: np.ndarray
    camera: Camera
    background: tuple[int, int, int]


StillDrawer = Callable[[StillRequest], np.ndarray]


class StillPicture(QWidget):
    """Lets the mouse through. Hidden until there is a picture."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setAccessibleName("Splats at rest")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self._image = QImage()
        self.hide()

    def show_picture(self, rgb: np.ndarray) -> None:
        """Show uint8 [H, W, 3], stretched to the widget when that has another size by now."""
        self._image = to_qimage(rgb)
        self.show()
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        with QPainter(self) as painter:  # ended even when painting fails; Qt crashes on a painter left open
            painter.drawImage(self.rect(), self._image)
