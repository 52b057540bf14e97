"""Lines over the splats of the 3D view, such as cameras and trails, drawn by VTK off the screen with their depths."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from PySide6.QtCore import QPointF
from PySide6.QtGui import QColor, QPainter

from degense.engine.camera import Camera
from degense.widgets.qt_images import to_array, to_qimage

#: How much nearer than a guide splats must be to hide it: what lies on a surface stays visible.
SLACK = 1.01

WIDTH = 2  # pixels
HIDDEN = 0.35  # opacity of what lies behind splats


class Guide(NamedTuple):
    """Connected points [N, 3], N ≥ 2, with a text at the last one."""

    points: np.ndarray
    colour: tuple[int, int, int]
    text: str = ""


_of_thread = threading.local()  # a plotter belongs to the thread that made it


def lay_over(image: np.ndarray, depth: np.ndarray, guides: Sequence[Guide], camera: Camera, stretch: float = 1.0) -> np.ndarray:
    """The image uint8 [H, W, 3] with the guides: plain before the splats, whose camera z is depth [H, W] (inf: none), faint behind them.

    They are as much finer as the image will be stretched.
    """
    pixels, guide_depth = _drawn(guides, camera, WIDTH / stretch)
    share = np.where(guide_depth < depth * SLACK, np.float32(1), np.float32(HIDDEN)) * np.isfinite(guide_depth)
    image = (image + share[..., None] * (pixels.astype(np.float32) - image) + 0.5).astype(np.uint8)
    named = [guide for guide in guides if guide.text and camera.project(guide.points[-1])[1] > 0]
    if not named:
        return image
    canvas = to_qimage(image)
    with QPainter(canvas) as painter:
        painter.scale(1 / stretch, 1 / stretch)
        for guide in named:
            painter.setPen(QColor(*guide.colour))
            painter.drawText(QPointF(*(camera.project(guide.points[-1])[0] * stretch + [4, -4])), guide.text)
    return to_array(canvas)


def _drawn(guides: Sequence[Guide], camera: Camera, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Guides through a camera, so many pixels wide: uint8 [H, W, 3] and camera z [H, W], inf where there are none."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkFloatArray, vtkUnsignedCharArray

    z = np.concatenate([guide.points for guide in guides]) @ camera.viewmat[2, :3] + camera.viewmat[2, 3]
    far = max(float(z.max()), 1e-6) * 1.5
    near, size = far * 1e-3, (camera.width, camera.height)
    if not hasattr(_of_thread, "plotter"):
        _of_thread.plotter = _plotter()
    plotter = _of_thread.plotter
    plotter.clear_actors()
    for guide in guides:
        _add(plotter, guide, width)
    _aim(plotter.camera, camera, near, far)
    window = plotter.render_window
    window.SetSize(*size)
    window.Render()
    colours, buffer = vtkUnsignedCharArray(), vtkFloatArray()
    window.GetRGBACharPixelData(0, 0, size[0] - 1, size[1] - 1, 0, colours)
    window.GetZbufferData(0, 0, size[0] - 1, size[1] - 1, buffer)
    flat = vtk_to_numpy(buffer).reshape(size[::-1])[::-1]
    with np.errstate(divide="ignore"):
        depth = np.where(flat < 1.0, 2 * near * far / (far + near - (2 * flat - 1) * (far - near)), np.inf)
    return vtk_to_numpy(colours).reshape(*size[::-1], 4)[::-1, :, :3], depth


def _plotter() -> Any:
    import pyvista

    plotter = pyvista.Plotter(off_screen=True)
    plotter.render_window.SetMultiSamples(0)
    plotter.renderer.camera_set = True  # otherwise pyvista frames the lines its own way
    return plotter


def _add(plotter: Any, guide: Guide, width: float) -> None:
    import pyvista

    line = pyvista.lines_from_points(guide.points)
    plotter.add_mesh(line, color=guide.colour, line_width=width, lighting=False, render=False, reset_camera=False)


def _aim(view: Any, camera: Camera, near: float, far: float) -> None:
    """Let VTK see what the camera sees between two depths."""
    from vtkmodules.vtkCommonMath import vtkMatrix4x4

    rotation = camera.viewmat[:3, :3]
    eye = -rotation.T @ camera.viewmat[:3, 3]
    view.SetPosition(*eye)
    view.SetFocalPoint(*(eye + rotation[2] * 0.5 * (near + far)))
    view.SetViewUp(*-rotation[1])
    view.SetClippingRange(near, far)
    matrix = vtkMatrix4x4()
    matrix.DeepCopy(projection_matrix(camera, near, far).ravel())
    view.SetExplicitProjectionTransformMatrix(matrix)
    view.SetUseExplicitProjectionTransformMatrix(True)


def projection_matrix(camera: Camera, near: float, far: float) -> np.ndarray:
    """OpenGL projection [4, 4] of an OpenCV camera: its image fills the viewport pixel for pixel; near and far are camera depths z."""
    return np.array(
        [
            [2.0 * camera.fx / camera.width, 0.0, 1.0 - 2.0 * camera.cx / camera.width, 0.0],
            [0.0, 2.0 * camera.fy / camera.height, 2.0 * camera.cy / camera.height - 1.0, 0.0],
            [0.0, 0.0, -(far + near) / (far - near), -2.0 * far * near / (far - near)],
            [0.0, 0.0, -1.0, 0.0],
        ]
    )
