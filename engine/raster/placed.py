"""Gaussians that stay where they are: projected and sorted once, then drawn with as many features as are asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from jaxtyping import Float
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.raster.cuda import PlacedOnCuda, blend_cuda, cleaned, project_cuda
from degense.engine.raster.render import BackProjection, transposed
from degense.engine.splats import Splats

if TYPE_CHECKING:
    from degense.engine.raster.cpu import PlacedOnCpu


class Placed:
    """Gaussians on the screen of a camera.

    It draws what `rasterize` draws with no background, and only features get a gradient. They must be finite: unlike `rasterize` it does
    not leave out a Gaussian for what it is asked to blend.
    """

    def __init__(self, splats: Splats, camera: Camera):
        self._means = splats.means.detach()
        placed: PlacedOnCpu | PlacedOnCuda
        if self._means.is_cuda:
            placed = on_cuda = project_cuda(cleaned(splats.detach()), camera)
            self._blend: Callable[[Tensor], Tensor] = lambda features: blend_cuda(on_cuda, features)[0]
        else:
            from degense.engine.raster.cpu import blend_cpu, project_cpu

            placed = on_cpu = project_cpu(splats, camera)
            self._blend = lambda features: blend_cpu(on_cpu, features)
        self.nbytes = sum(part.nbytes for part in placed if hasattr(part, "nbytes"))

    def draw(self, features: Float[Tensor, "n c"]) -> Float[Tensor, "height width c"]:
        """The picture of features."""
        return self._blend(features)

    def backproject(
        self, values: Float[Tensor, "height width c"], confidence: Float[Tensor, "height width"] | None = None
    ) -> BackProjection:
        """As `engine.raster.backproject`."""
        return transposed(self.draw, values, confidence, self._means)
