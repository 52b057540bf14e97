"""Splats on the screen by VTK, for machines whose OpenGL runs on a GPU."""

from __future__ import annotations

import numpy as np
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget
from pyvistaqt import QtInteractor

from degense.engine.camera import Camera
from degense.widgets.frame.images import to_array
from degense.widgets.splats.gaussians import Gaussians
from degense.widgets.splats.scene_painter import ScenePainter


class VtkSurface:
    """Draws points while the hand moves, and sorted splats when it rests.

    Attributes
    ----------
    widget : QWidget
        What is on the screen.
    """

    def __init__(self, parent: QWidget) -> None:
        self.widget = QtInteractor(parent, auto_update=False, multi_samples=0)
        self._painter = ScenePainter(self.widget)

    def set_splats(self, gaussians: Gaussians, colours: np.ndarray) -> None:
        """Show other splats, colours uint8 [N, 3], from the next `view_state` on."""
        self._painter.set_splats(gaussians, colours)

    def set_colours(self, colours: np.ndarray, opacities: np.ndarray) -> None:
        self._painter.set_colours(colours, opacities)
        self.widget.update()

    def set_background(self, colour: QColor) -> None:
        self.widget.renderer.SetBackground(colour.redF(), colour.greenF(), colour.blueF())
        self.widget.update()

    def view_state(self, camera: Camera, lowpass_scale: float, moving: bool) -> None:
        """Look through a camera whose image fills the widget; `lowpass_scale` as in `ScenePainter.set_camera`."""
        self._painter.show_points(moving)
        self._painter.set_camera(camera, lowpass_scale)
        if not moving:
            self._painter.sort()
        self.widget.update()

    def picture(self) -> np.ndarray:
        """What is on the screen, uint8 [H, W, 3] in device pixels."""
        return to_array(self.widget.grabFramebuffer())
