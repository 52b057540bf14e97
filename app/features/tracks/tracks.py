"""Points of a session and of a track file, followed through a scene, and what is written of them. No Qt."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from degense.app.features.inspect.curves import table_of
from degense.app.features.tracks.state import Point
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.data.files.point_files import KnownPoints
    from degense.engine.scene import Scene
    from degense.engine.scene.tracks import Tracks


def follow(scene: Scene, points: Sequence[Point]) -> Steps[dict[Point, Tracks]]:
    """The way of each point: positions [T, 3], pixels [T, 2] and visible [T].

    From the frame of each of its queries on it is followed from there; before the first one, backwards from there.
    """
    from degense.engine.scene.tracks import Tracks, following

    found = yield from following(scene, np.array([query for point in points for query in point.queries]))
    frames, ways, first = np.arange(scene.frames), {}, 0
    for point in points:
        rows = first + np.searchsorted([query[0] for query in point.queries[1:]], frames, side="right")
        ways[point] = Tracks(*(values[rows, frames] for values in found))
        first += len(point.queries)
    return ways


def without_recording(scene: Scene) -> str:
    """What is to be known of points that are followed without the recording, one sentence; empty with it."""
    return (
        "" if scene.clip is not None else f"Points move as the reconstruction does, because the recording is missing: {scene.clip_missing}."
    )


class TrackComparison(NamedTuple):
    """What a file says of points, what following them from where it first sees them gives, and how near that is (`score_known_points`)."""

    known: KnownPoints
    found: Tracks
    scores: dict[str, Any]

    def __str__(self) -> str:
        if not self.scores["pairs"]:
            return f"{len(self.known.pixels)} points, each known in one frame only; there is nothing to score."
        shares = {"δ": "delta", "Jaccard": "jaccard", "occlusion": "occlusion_accuracy"}
        words = [f"{len(self.known.pixels)} points", *(f"{name} {self.scores[key]:.1%}" for name, key in shares.items())]
        if self.scores["endpoint_error"] is not None:
            words.append("endpoint error {endpoint_error:.1f} px, median {endpoint_error_median:.1f} px".format(**self.scores))
        if self.scores.get("endpoint_error_mm") is not None:
            words.append("in space {endpoint_error_mm:.2f} mm, median {endpoint_error_mm_median:.2f} mm".format(**self.scores))
        return " · ".join(words)


def compare(scene: Scene, path: Path) -> Steps[TrackComparison]:
    """Follow the points of a file. ClipError when it is none of this clip."""
    from degense.engine.data.files.point_files import read_points
    from degense.engine.metrics.tracks import score_known_points
    from degense.engine.scene.tracks import following

    known = read_points(path, scene.frames, scene.clip_size)
    found = yield from following(scene, known.queries)
    return TrackComparison(known.paired(found.pixels), found, score_known_points(scene, found, known))


def reach(way: np.ndarray, frame: int) -> float:
    """How far a point whose way is known in some frames, [T, 2] or [T, 3], gets from where it is at a frame."""
    return float(np.nanmax(np.linalg.norm(way - way[frame], axis=-1)))


def tracks_json(unit: str, queries: np.ndarray, found: Tracks, scores: dict[str, Any]) -> str:
    """For each point its query (frame, x, y) and, by frame, its pixels, its position in the clip's unit (null where it is unknown) and
    whether it is visible. Pixels are rounded to a thousandth, positions to the sixth digit of the farthest, which halves the text.
    """
    points = []
    farthest = np.abs(found.positions[np.isfinite(found.positions)]).max(initial=1e-9)
    rounded = found.pixels.round(3), found.positions.round(5 - int(np.floor(np.log10(farthest))))
    for query, pixels, positions, visible in zip(queries, *rounded, found.visible, strict=True):
        places, space = (values.tolist() if np.isfinite(values).all() else None for values in (pixels, positions))
        points.append({"query": query.tolist(), "pixels": places, "positions": space, "visible": visible.tolist()})
    return json.dumps({"unit": unit, "points": points, "scores": scores})


def tracks_csv(numbers: Sequence[int], found: Tracks) -> str:
    """A row for each frame and point, by their numbers, at which something is reconstructed; X, Y and Z in the clip's unit and world."""
    frame, point = np.nonzero(np.isfinite(found.pixels).all(-1).T)
    columns = {"frame": frame, "point": np.asarray(numbers)[point]} | dict(zip("xy", found.pixels[point, frame].T, strict=True))
    columns |= {"visible": found.visible[point, frame].astype(int)} | dict(zip("XYZ", found.positions[point, frame].T, strict=True))
    return table_of(columns)
