"""Draws Gaussians with VTK, the same on the screen and off it.

VTK's point Gaussian mapper projects and blends true anisotropic Gaussians, but only in the order in which the vertices come, so the painter
sorts them far to near whenever the camera or the centres change. Order-independent transparency would replace that order by a worse one
and is switched off.
"""

from __future__ import annotations

import numpy as np
import pyvista as pv
from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonDataModel import vtkCellArray
from vtkmodules.vtkCommonMath import vtkMatrix4x4

from degense.engine.camera import Camera
from degense.widgets.splats.gaussians import Gaussians

#: Screen-space dilation of every splat, squared pixels: what rasterizers of Gaussians add against aliasing.
LOWPASS = 0.3


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


#: Points that are drawn at most while the camera moves.
MOST_POINTS = 40_000


def _every(count: int) -> int:
    """Of `count` splats, each how manieth is drawn as a point."""
    return max(1, -(-count // MOST_POINTS))


class ScenePainter:
    """The splats of one plotter.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
        A `pyvista.Plotter` or a `pyvistaqt.QtInteractor`. The painter never renders; its owner does, once, after all changes.
    """

    def __init__(self, plotter: pv.BasePlotter) -> None:
        self._plotter = plotter
        self._mesh: pv.PolyData | None = None
        self._actor: pv.Actor | None = None
        self._points: pv.Actor | None = None
        self._cloud: pv.PolyData | None = None
        self._means = np.zeros((0, 3), np.float32)
        self._camera: Camera | None = None
        self._lowpass = (0.0, 0.0)
        plotter.renderer.SetUseOIT(False)
        plotter.renderer.camera_set = True  # otherwise pyvista frames the scene its own way at the first rendering

    def set_splats(self, gaussians: Gaussians) -> None:
        """Show other splats. Call `sort` before they are to be right."""
        self._means = gaussians.means
        if self._mesh is None or self._mesh.n_points != len(gaussians.means):
            self._build(gaussians)
        else:
            self._mesh.points = gaussians.means
            self._fill(self._mesh, gaussians)
        self._fill_cloud()

    def set_camera(self, camera: Camera, lowpass_scale: float = 1.0) -> None:
        """Show the scene through `camera`, whose image fills the viewport. Call `sort` before the splats are to be right.

        `lowpass_scale` is the number of viewport pixels a pixel of the image that is being matched takes.
        """
        self._camera = camera
        near, far = self._depth_range(camera)
        rotation, translation = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
        eye = -rotation.T @ translation
        view = self._plotter.renderer.GetActiveCamera()
        view.SetPosition(*eye)
        view.SetFocalPoint(*(eye + rotation[2] * 0.5 * (near + far)))
        view.SetViewUp(*-rotation[1])
        view.SetClippingRange(near, far)
        matrix = vtkMatrix4x4()
        matrix.DeepCopy(projection_matrix(camera, near, far).ravel())
        view.SetExplicitProjectionTransformMatrix(matrix)
        view.SetUseExplicitProjectionTransformMatrix(True)
        self._lowpass = (LOWPASS * (2.0 * lowpass_scale / camera.width) ** 2, LOWPASS * (2.0 * lowpass_scale / camera.height) ** 2)
        if self._actor is not None:
            self._actor.mapper.SetLowpassMatrix(self._lowpass[0], 0.0, self._lowpass[1])

    def sort(self) -> None:
        """Order the splats far to near for the present camera."""
        if self._mesh is None or self._camera is None:
            return
        depth = self._means @ self._camera.viewmat[2, :3].astype(np.float32)
        order = np.argsort(-depth)
        cells = vtkCellArray()
        offsets = np.arange(len(order) + 1, dtype=np.int64)
        cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(order.astype(np.int64), deep=True))
        self._mesh.SetVerts(cells)

    def show_points(self, on: bool) -> None:
        """Draw plain points (fast on software GL, any order; some of them when there are many) or the splats."""
        if self._actor is not None and self._points is not None:
            self._actor.visibility = not on
            self._points.visibility = on
            self._fill_cloud()

    def _fill_cloud(self) -> None:
        """Put the present centres and colours into the points, when they are shown.

        They have arrays of their own: VTK keeps one buffer an array on the GPU for all mappers, and the one that draws points shifts the
        coordinates in it, which the one that draws splats does not know.
        """
        if self._points is not None and self._points.visibility:
            assert self._cloud is not None
            assert self._mesh is not None
            step = _every(len(self._means))
            self._cloud.points = self._means[::step].copy()
            self._cloud.point_data["colour"] = np.array(self._mesh.point_data["colour"])[::step].copy()

    def _depth_range(self, camera: Camera) -> tuple[float, float]:
        """Clipping planes that keep every splat in front of the camera."""
        if not len(self._means):
            return 0.1, 10.0
        depth = self._means @ camera.viewmat[2, :3] + camera.viewmat[2, 3]
        far = max(float(depth.max()), 1e-6) * 1.5
        return far * 1e-3, far

    def _build(self, gaussians: Gaussians) -> None:
        if self._actor is not None:
            self._plotter.remove_actor([self._actor, self._points], render=False)
            self._actor, self._points, self._mesh, self._cloud = None, None, None, None
        if not len(gaussians.means):
            return
        mesh = pv.PolyData(gaussians.means)
        self._fill(mesh, gaussians)
        plain = {"scalars": "colour", "rgb": True, "lighting": False, "render": False, "reset_camera": False, "show_scalar_bar": False}
        actor = self._plotter.add_mesh(mesh, style="points_gaussian", emissive=False, **plain)
        mapper = actor.mapper
        mapper.scale_factor = 1.0
        mapper.SetScaleArray("scale")
        mapper.SetRotationArray("rotation")
        mapper.SetOpacityArray("opacity")
        mapper.AnisotropicOn()
        actor.ForceTranslucentOn()
        mapper.SetLowpassMatrix(self._lowpass[0], 0.0, self._lowpass[1])
        step = _every(len(gaussians.means))
        cloud = pv.PolyData(gaussians.means[::step].copy())
        cloud.point_data["colour"] = gaussians.colours[::step].copy()
        points = self._plotter.add_mesh(cloud, style="points", point_size=3.0, **plain)
        points.visibility = False
        self._mesh, self._actor, self._points, self._cloud = mesh, actor, points, cloud

    @staticmethod
    def _fill(mesh: pv.PolyData, gaussians: Gaussians) -> None:
        mesh.point_data["rotation"] = gaussians.quats
        mesh.point_data["scale"] = gaussians.scales
        mesh.point_data["opacity"] = gaussians.opacities
        mesh.point_data["colour"] = gaussians.colours
