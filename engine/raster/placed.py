"""Gaussians that stay where they are: projected and sorted once, then drawn with as many features as are asked for."""

from __future__ import annotations

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.raster.cuda import blend_cuda, cleaned, project_cuda
from degense.engine.raster.render import BackProjection, transposed
from degense.engine.splats import Splats


class Placed:
    """Gaussians on the screen of a camera.

    It draws what `rasterize` draws with no background, and only features get a gradient. They must be finite: unlike `rasterize` it does
    not leave out a Gaussian for what it is asked to blend.
    """

    def __init__(self, splats: Splats, camera: Camera):
        self._means = splats.means.detach()
        self._blend: Callable[[Tensor], Tensor]
        if self._means.is_cuda:
            placed = project_cuda(cleaned(splats.detach()), camera)
            self._blend = lambda features: blend_cuda(placed, features)[0]
        else:
            from degense.engine.raster.cpu import blend_cpu, project_cpu

            placed = project_cpu(splats, camera)
            self._blend = lambda features: blend_cpu(placed, features)
        self.nbytes = sum(part.nbytes for part in placed if hasattr(part, "nbytes"))

    def draw(self, features: Float[Tensor, "n c"]) -> Float[Tensor, "height width c"]:
        """The picture of features."""
        return self._blend(features)

    def backproject(
        self, values: Float[Tensor, "height width c"], confidence: Float[Tensor, "height width"] | None = None
    ) -> BackProjection:
        """As `engine.raster.backproject`."""
        return transposed(self.draw, values, confidence, self._means)
