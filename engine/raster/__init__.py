"""Drawing Gaussians: `rasterize` and its back ends (float64 reference, numba on the CPU, gsplat on CUDA)."""

from degense.engine.raster.camera_tensors import camera_depths
from degense.engine.raster.render import Render, rasterize

__all__ = ["Render", "camera_depths", "rasterize"]
