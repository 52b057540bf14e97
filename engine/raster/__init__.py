"""Drawing Gaussians: `rasterize`, its transpose `backproject`, `Placed` for drawing a frame many times; by numba or gsplat (CUDA)."""

from degense.engine.raster.camera_tensors import camera_depths
from degense.engine.raster.placed import Placed
from degense.engine.raster.render import BackProjection, Render, backproject, rasterize

__all__ = ["BackProjection", "Placed", "Render", "backproject", "camera_depths", "rasterize"]
