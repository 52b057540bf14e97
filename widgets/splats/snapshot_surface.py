"""Splats on the screen as snapshots that are rendered elsewhere, for machines without a GPU."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QColor, QOffscreenSurface, QOpenGLContext, QPixmap
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget

from degense.engine.camera import Camera
from degense.widgets.qt_images import to_array, to_qimage
from degense.widgets.splats.camera_moves import letterboxed
from degense.widgets.splats.gaussians import Gaussians

#: What OpenGL implementations on the processor call themselves, in small letters, and the enumerator that asks for the name.
SOFTWARE, GL_RENDERER = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software"), 0x1F01

#: A snapshot that is requested so soon after the last one is rendered coarsely, and again finely when nothing changes for so long (ms).
REST_MS = 120

#: Screen pixels a side of a pixel of a coarse snapshot.
COARSE = 2


class SnapshotRequest(NamedTuple):
    """Gaussians, to be rendered through a camera over a background (0 to 255)."""

    gaussians: Gaussians
    camera: Camera
    background: tuple[int, int, int]


SnapshotDrawer = Callable[[SnapshotRequest], np.ndarray]


class SnapshotSurface(QLabel):
    """Requests a snapshot whenever something has changed, and shows the last one, stretched, until it comes.

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
        self.setScaledContents(True)
        self.setAutoFillBackground(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self._draw = draw
        self._wanted: SnapshotRequest | None = None
        self._rest = QTimer(self, singleShot=True, interval=REST_MS)
        self._rest.timeout.connect(self._refine)
        self._coarse = False

    def set_background(self, colour: QColor) -> None:
        """What is seen until there is a snapshot."""
        palette = self.palette()
        palette.setColor(palette.ColorRole.Window, colour)
        self.setPalette(palette)

    def show_splats(self, wanted: SnapshotRequest, lowpass_scale: float, moving: bool) -> None:
        """Show splats through a camera whose image fills the widget."""
        self._wanted = wanted
        self.wanted.emit()

    def request(self) -> SnapshotRequest | None:
        """What is to be rendered now; None without splats."""
        self._coarse = self._rest.isActive()
        if self._wanted is None or not self._coarse:
            return self._wanted
        camera = self._wanted.camera
        return self._wanted._replace(camera=letterboxed(camera, max(1, camera.width // COARSE), max(1, camera.height // COARSE)))

    def take(self, rgb: np.ndarray) -> None:
        """Show a snapshot of `request`, uint8 [H, W, 3]."""
        self.setPixmap(QPixmap.fromImage(to_qimage(rgb)))
        self._rest.start()

    def grab_image(self) -> np.ndarray:
        """What is on the screen when nothing moves, uint8 [H, W, 3] in device pixels."""
        return to_array(self.grab().toImage()) if self._wanted is None else self._draw(self._wanted)

    def _refine(self) -> None:
        if self._coarse and self._wanted is not None:
            self.wanted.emit()


def has_gpu() -> bool:
    """Whether OpenGL draws on a GPU: not where it runs on the processor, or is not there at all."""
    surface, context = QOffscreenSurface(), QOpenGLContext()
    surface.create()
    if not (context.create() and context.makeCurrent(surface)):
        return False
    name = str(context.functions().glGetString(GL_RENDERER)).lower()
    context.doneCurrent()
    return not any(word in name for word in SOFTWARE)
