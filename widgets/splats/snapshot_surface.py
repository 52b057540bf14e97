"""Splats on the screen as snapshots that are rendered elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QColor, QPixmap
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget

from degense.engine.camera import Camera
from degense.widgets.qt_images import to_array, to_qimage
from degense.widgets.splats.gaussians import Gaussians
from degense.widgets.splats.guides import Guide

#: A snapshot that is requested so soon after the last one is rendered coarsely, and again finely when nothing changes for so long (ms).
REST_MS = 120

#: Screen pixels a side of a pixel of a coarse snapshot, and from how many milliseconds for a fine one on snapshots are coarse at first.
COARSE, SLOW_MS = 2, 25.0


class SnapshotRequest(NamedTuple):
    """Gaussians, to be rendered through a camera over a background (0 to 255), with guides over them."""

    gaussians: Gaussians
    camera: Camera
    background: tuple[int, int, int]
    guides: Sequence[Guide] = ()
    stretch: float = 1.0  # how many times larger the picture will be shown


SnapshotDrawer = Callable[[SnapshotRequest], np.ndarray]


class SnapshotSurface(QLabel):
    """Requests a snapshot whenever something has changed, and shows the last one, stretched, until it comes.

    An OpenGL widget would have the whole window composed by OpenGL at every painting, which takes long where there is no GPU.
    """

    wanted = Signal()  # a snapshot of `request` should be rendered and given to `take`

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
        self._coarse, self._slow, self._asked = False, True, 0.0

    def set_background(self, colour: QColor) -> None:
        """What is seen until there is a snapshot."""
        palette = self.palette()
        palette.setColor(palette.ColorRole.Window, colour)
        self.setPalette(palette)

    def show_splats(self, wanted: SnapshotRequest) -> None:
        """Show splats through a camera whose image fills the widget."""
        self._wanted = wanted
        self.wanted.emit()

    def request(self) -> SnapshotRequest | None:
        """What is to be rendered now; None without splats."""
        self._coarse, self._asked = self._slow and self._rest.isActive(), time.perf_counter()
        if self._wanted is None or not self._coarse:
            return self._wanted
        camera = self._wanted.camera
        smaller = camera.letterboxed(max(1, camera.width // COARSE), max(1, camera.height // COARSE))
        return self._wanted._replace(camera=smaller, stretch=COARSE)

    def take(self, rgb: np.ndarray) -> None:
        """Show a snapshot of `request`, uint8 [H, W, 3]."""
        self.setPixmap(QPixmap.fromImage(to_qimage(rgb)))
        if not self._coarse:
            self._slow = 1000 * (time.perf_counter() - self._asked) > SLOW_MS
        self._rest.start()

    def grab_image(self) -> np.ndarray:
        """What is on the screen when nothing moves, uint8 [H, W, 3] in device pixels."""
        return to_array(self.grab().toImage()) if self._wanted is None else self._draw(self._wanted)

    def _refine(self) -> None:
        if self._coarse and self._wanted is not None:
            self.wanted.emit()
