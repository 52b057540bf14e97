"""Drawing Gaussians: `rasterize`, its transpose `backproject`, and its back ends (numba on the CPU, gsplat on CUDA)."""

from degense.engine.raster.camera_tensors import camera_depths
from degense.engine.raster.render import BackProjection, Render, backproject, rasterize

__all__ = ["BackProjection", "Render", "backproject", "camera_depths", "rasterize"]
