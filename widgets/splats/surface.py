"""What draws splats on the screen, and which kind of it this machine needs."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from PySide6.QtGui import QColor, QOffscreenSurface, QOpenGLContext
from PySide6.QtWidgets import QWidget

from degense.engine.camera import Camera
from degense.widgets.splats.gaussians import Gaussians

#: What OpenGL implementations on the processor call themselves, in small letters, and the enumerator that asks for the name.
SOFTWARE, GL_RENDERER = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software"), 0x1F01


class Surface(Protocol):
    """`VtkSurface` on a GPU, `SnapshotSurface` without one."""

    @property
    def widget(self) -> QWidget:
        """What is on the screen."""

    def set_splats(self, gaussians: Gaussians, colours: np.ndarray) -> None:
        """Show other splats, colours uint8 [N, 3], from the next `set_camera` on."""

    def set_colours(self, colours: np.ndarray, opacities: np.ndarray) -> None:
        """Change only colours uint8 [N, 3] and opacities [N]."""

    def set_background(self, colour: QColor) -> None: ...

    def set_camera(self, camera: Camera, lowpass_scale: float, moving: bool) -> None:
        """Show the splats through a camera whose image fills the widget; `lowpass_scale` as in `ScenePainter.set_camera`."""

    def grab(self) -> np.ndarray:
        """What is on the screen when nothing moves, uint8 [H, W, 3] in device pixels."""


def has_gpu() -> bool:
    """Whether OpenGL draws on a GPU: not where it runs on the processor, or is not there at all."""
    surface, context = QOffscreenSurface(), QOpenGLContext()
    surface.create()
    if not (context.create() and context.makeCurrent(surface)):
        return False
    name = str(context.functions().glGetString(GL_RENDERER)).lower()
    context.doneCurrent()
    return not any(word in name for word in SOFTWARE)
