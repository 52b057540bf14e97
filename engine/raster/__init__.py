"""Drawing Gaussians: `rasterize`, its transpose `backproject`, and its back ends (numba on the CPU, gsplat on CUDA)."""

from degense.engine.raster.backproject import BackProjection, backproject
from degense.engine.raster.camera_tensors import camera_depths
from degense.engine.raster.render import Render, rasterize

__all__ = ["BackProjection", "Render", "backproject", "camera_depths", "rasterize"]
