"""Maps of all values of one frame, for the probe."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from degense.app.features.viewer.layer_images import get_layer

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: Classes that are listed for a pixel.
BEST = 5
#: Values that are looked up under the pointer, those that cost little first.
PROBED = ("depth", "displacement", "speed", "rotation", "scale", "warp")


class ClassDirections:
    """Every class of a scene and of its vocabulary, as directions of the latent."""

    def __init__(self, scene: Scene) -> None:
        assert scene.encoder is not None
        assert scene.basis is not None
        self.names = tuple(dict.fromkeys([*scene.classes, *scene.encoder.complete("")]))
        self._rows = scene.basis.project(scene.encoder.encode(list(self.names)))

    def best(self, latent: np.ndarray) -> list[tuple[str, float]]:
        """The classes most similar to a latent [d], with their cosines, the best first; none for a latent that says nothing."""
        length = float(np.linalg.norm(latent))
        if not length > 1e-6:
            return []
        cosines = self._rows @ (latent / length)
        return [(self.names[index], float(cosines[index])) for index in np.argsort(-cosines, kind="stable")[:BEST]]


@dataclass(frozen=True)
class ProbeMaps:
    """Values of every pixel of one frame, so that hovering only looks them up. What is not drawn yet is None."""

    frame: int
    rgb: np.ndarray
    units: dict[str, str]
    scalars: dict[str, np.ndarray] = field(default_factory=dict)  # of `PROBED`, float [H, W]
    uncertain: dict[str, np.ndarray] = field(default_factory=dict)  # where one of them is a guess, bool [H, W]
    latent: np.ndarray | None = None  # float32 [H, W, d]; the semantic latents
    directions: ClassDirections | None = None  # the classes that they are compared with

    def colour(self, x: int, y: int) -> tuple[int, int, int]:
        red, green, blue = (int(channel) for channel in self.rgb[y, x])
        return red, green, blue

    def rows(self, x: int, y: int) -> list[tuple[str, str]]:
        """Label and text of each value at a pixel, for the probe panel."""
        rows = [("position", f"{x}, {y} px"), ("colour", "{} {} {}".format(*self.colour(x, y)))]
        for name, values in self.scalars.items():
            value = float(values[y, x])
            guess = " (a guess)" if name in self.uncertain and self.uncertain[name][y, x] else ""
            rows.append((name, f"{round(value, 6):.3g} {self.units[name]}".strip() + guess if np.isfinite(value) else "not known here"))
        for rank, (name, cosine) in enumerate(self.why(x, y), 1):
            rows.append((f"class {rank}", f"{name}  {cosine:.2f}"))
        return rows

    def why(self, x: int, y: int) -> list[tuple[str, float]]:
        """The classes of the scene and its vocabulary that a pixel is most similar to, with their cosines, the best first."""
        return [] if self.latent is None or self.directions is None else self.directions.best(self.latent[y, x])


def probe_maps(scene: Scene, frame: int) -> Generator[ProbeMaps, None, ProbeMaps]:
    """The maps of a frame. Yields what is there as it grows; returns all."""
    from degense.engine.layers import LayerRequest

    request = LayerRequest(frame=frame)
    maps = ProbeMaps(frame, scene.render_rgb(frame), {})
    yield maps
    for name in PROBED:
        if get_layer(name).missing(scene, ()):
            continue
        image = get_layer(name).image(scene, request)
        maps = replace(maps, scalars=maps.scalars | {name: image.values}, units=maps.units | {name: image.unit})
        if image.uncertain is not None:
            maps = replace(maps, uncertain=maps.uncertain | {name: image.uncertain})
        yield maps
    if scene.has_semantics:
        maps = replace(maps, latent=scene.render(frame, what=("latent",))["latent"], directions=ClassDirections(scene))
    return maps
