"""Splats on the screen by VTK, for machines whose OpenGL runs on a GPU."""

from __future__ import annotations

import numpy as np
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget
from pyvistaqt import QtInteractor

from degense.engine.camera import Camera
from degense.widgets.qt_images import to_array
from degense.widgets.splats.gaussians import Gaussians
from degense.widgets.splats.scene_painter import ScenePainter


class VtkSurface:
    """A `Surface` that draws points while the camera moves, and sorted splats when it rests."""

    def __init__(self, parent: QWidget) -> None:
        self.widget = QtInteractor(parent, auto_update=False, multi_samples=0)
        self._painter = ScenePainter(self.widget)

    def set_splats(self, gaussians: Gaussians, colours: np.ndarray) -> None:
        self._painter.set_splats(gaussians, colours)

    def set_colours(self, colours: np.ndarray, opacities: np.ndarray) -> None:
        self._painter.set_colours(colours, opacities)
        self.widget.update()

    def set_background(self, colour: QColor) -> None:
        self.widget.renderer.SetBackground(colour.redF(), colour.greenF(), colour.blueF())
        self.widget.update()

    def set_camera(self, camera: Camera, lowpass_scale: float, moving: bool) -> None:
        self._painter.show_points(moving)
        self._painter.set_camera(camera, lowpass_scale)
        if not moving:
            self._painter.sort()
        self.widget.update()

    def grab(self) -> np.ndarray:
        return to_array(self.widget.grabFramebuffer())
