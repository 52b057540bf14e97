"""`degense track`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.app.cli.terminal import Bar, table
from degense.app.features.viewer.layer_images import check_frame
from degense.engine.files import write_text

if TYPE_CHECKING:
    from degense.engine.scene.tracks import Tracks

MOST_SAID = 20  # points that are told one by one


def track(options: argparse.Namespace) -> None:
    """Follow points through a run: say where they go, and how near that is to what a file knows of them."""
    from degense.engine.data.files.point_files import read_points
    from degense.engine.metrics.tracks import score_points
    from degense.engine.scene import Scene
    from degense.engine.scene.tracks import follow_points

    scene = Scene.open(options.run_folder)
    known = None
    if options.points is not None:
        known = read_points(options.points, scene.frames, scene.clip_size)
        queries = known.queries
    else:
        x, y = np.meshgrid(*((np.arange(options.grid) + 0.5) / options.grid * side for side in scene.clip_size))
        queries = np.c_[np.full(x.size, check_frame(scene, options.frame)), x.ravel(), y.ravel()]
    bar = Bar()
    found = follow_points(scene, queries, bar)
    bar.close()
    scores: dict[str, Any] = score_points(found.pixels, found.visible, known.pixels, known.hidden) if known else {}
    if options.json is not None:
        _write(options.json, scene.unit, queries, found, scores)
    _say(queries, found)
    if scores.get("pairs"):
        print(table(scores))


def _say(queries: np.ndarray, found: Tracks) -> None:
    followed = np.isfinite(found.pixels).all((1, 2))
    print(f"{followed.sum()} of {len(queries)} points followed; nothing is reconstructed at the others")
    for number in np.flatnonzero(followed)[:MOST_SAID]:
        frame, x, y = queries[number]
        way = np.linalg.norm(found.pixels[number] - found.pixels[number, round(frame)], axis=-1).max()
        print(
            f"({x:.0f}, {y:.0f}) in frame {frame:.0f}: up to {way:.1f} px away, visible in {found.visible[number].mean():.0%} of the frames"
        )


def _write(path: Path, unit: str, queries: np.ndarray, found: Tracks, scores: dict[str, Any]) -> None:
    """For each point its query (frame, x, y) and, by frame, its pixels, its position in the clip's unit (null where it is unknown) and
    whether it is visible."""
    points = []
    for query, pixels, positions, visible in zip(queries, *found[1::-1], found.visible, strict=True):
        places = pixels.tolist() if np.isfinite(pixels).all() else None
        points.append({"query": query.tolist(), "pixels": places, "positions": places and positions.tolist(), "visible": visible.tolist()})
    write_text(path, json.dumps({"unit": unit, "points": points, "scores": scores}))
