"""Measures followed through a scene: their values in every frame, and the table of them. No Qt."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from degense.app.features.inspect.curves import table_of
from degense.app.features.measure.state import Measure
from degense.engine.layer_titles import with_unit
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.scene import Scene


class Quantity(NamedTuple):
    """A number that changes over time."""

    title: str
    unit: str
    values: np.ndarray  # float64 [T]; NaN where it is not known
    start: int  # frame in which it was chosen

    @property
    def change(self) -> np.ndarray:
        """What it has grown by since it was chosen."""
        return self.values - self.values[self.start]


class Measured(NamedTuple):
    """A measure in every frame."""

    quantities: tuple[Quantity, ...]
    pixels: np.ndarray  # float64 [K, T, 2]: its corners in the surgeon's camera
    positions: np.ndarray  # float64 [K, T, 3]: its corners in the world


def follow_measures(scene: Scene, measures: Sequence[Measure]) -> Steps[dict[Measure, Measured]]:
    """The values of each measure in every frame. Nothing is known of one whose corners lie where nothing is reconstructed."""
    from degense.engine.scene.measures import cover
    from degense.engine.scene.tracks import following

    covers = [cover(np.array(measure.corners)) if measure.kind == "area" else None for measure in measures]
    places = [found.pixels if found is not None else np.array(of.corners) for of, found in zip(measures, covers, strict=True)]
    queries = [np.column_stack([np.full(len(of), measure.frame), of]) for measure, of in zip(measures, places, strict=True)]
    tracks = yield from following(scene, np.concatenate(queries))
    found, first = {}, 0
    for measure, of, surface in zip(measures, places, covers, strict=True):
        rows = slice(first, first + len(of))
        first += len(of)
        positions = tracks.positions[rows]
        triangles = surface.triangles if surface is not None else None
        corners = slice(len(measure.corners))
        found[measure] = Measured(_quantities(scene, measure, positions, triangles), tracks.pixels[rows][corners], positions[corners])
    return found


def _quantities(scene: Scene, measure: Measure, positions: np.ndarray, triangles: np.ndarray | None) -> tuple[Quantity, ...]:
    from degense.engine.scene.measures import facing, known_triangles, path_length, surface_area, swept_volume

    unit, start = scene.unit, measure.frame
    if triangles is None:
        return (Quantity(measure.title, unit, path_length(positions), start),)
    nothing = np.full(scene.frames, np.nan)
    known = known_triangles(positions, triangles)
    volume = f"Volume change {measure.number}"
    if not len(known):
        return (Quantity(measure.title, f"{unit}²", nothing, start), Quantity(volume, f"{unit}³", nothing, start))
    eye = scene.camera(start).unproject(np.zeros(2), np.array(0.0))
    towards = facing(positions, known, eye, start)
    return (
        Quantity(measure.title, f"{unit}²", surface_area(positions, known), start),
        Quantity(volume, f"{unit}³", swept_volume(positions, towards, start), start),
    )


def quantities_csv(quantities: Iterable[Quantity], fps: float) -> str:
    """A row for each frame, a column for each quantity."""
    listed = list(quantities)
    frames = np.arange(len(listed[0].values)) if listed else np.zeros(0, int)
    return table_of({"frame": frames, "time [s]": frames / fps} | {with_unit(item.title, item.unit): item.values for item in listed})
