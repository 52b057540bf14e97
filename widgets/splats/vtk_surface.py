"""Splats on the screen by VTK, for machines whose OpenGL runs on a GPU."""

from __future__ import annotations

import numpy as np
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget
from pyvistaqt import QtInteractor

from degense.widgets.qt_images import to_array
from degense.widgets.splats.gaussians import Gaussians
from degense.widgets.splats.scene_painter import ScenePainter
from degense.widgets.splats.snapshot_surface import SnapshotRequest


class VtkSurface:
    """Draws points while the camera moves, and sorted splats when it rests."""

    def __init__(self, parent: QWidget) -> None:
        self.widget = QtInteractor(parent, auto_update=False, multi_samples=0)
        self._painter = ScenePainter(self.widget)
        self._gaussians: Gaussians | None = None

    def set_background(self, colour: QColor) -> None:
        self.widget.renderer.SetBackground(colour.redF(), colour.greenF(), colour.blueF())
        self.widget.update()

    def show_splats(self, wanted: SnapshotRequest, lowpass_scale: float, moving: bool) -> None:
        """Show splats through a camera whose image fills the widget; `lowpass_scale` as in `ScenePainter.set_camera`."""
        if wanted.gaussians is not self._gaussians:
            self._gaussians = wanted.gaussians
            self._painter.set_splats(wanted.gaussians)
        self._painter.show_points(moving)
        self._painter.set_camera(wanted.camera, lowpass_scale)
        if not moving:
            self._painter.sort()
        self.widget.update()

    def grab_image(self) -> np.ndarray:
        """What is on the screen when nothing moves, uint8 [H, W, 3] in device pixels."""
        return to_array(self.widget.grabFramebuffer())
