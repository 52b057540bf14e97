"""`degense track`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.app.cli.terminal import Bar, run_steps, table
from degense.app.features.tracks.tracks import reach, tracks_json
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
    from degense.engine.scene.tracks import following

    scene = Scene.open(options.run_folder)
    known = None
    if options.points is not None:
        known = read_points(options.points, scene.frames, scene.clip_size)
        queries = known.queries
    else:
        x, y = np.meshgrid(*((np.arange(options.grid) + 0.5) / options.grid * side for side in scene.clip_size))
        queries = np.c_[np.full(x.size, check_frame(scene, options.frame)), x.ravel(), y.ravel()]
    found = run_steps(following(scene, queries), Bar())
    scores: dict[str, Any] = score_points(found.pixels, found.visible, known.pixels, known.hidden) if known else {}
    if options.json is not None:
        write_text(options.json, tracks_json(scene.unit, queries, found, scores))
    _say(queries, found)
    if scores.get("pairs"):
        print(table(scores))


def _say(queries: np.ndarray, found: Tracks) -> None:
    followed = np.isfinite(found.pixels).all((1, 2))
    print(f"{followed.sum()} of {len(queries)} points followed; nothing is reconstructed at the others")
    for number in np.flatnonzero(followed)[:MOST_SAID]:
        frame, x, y = queries[number]
        way, share = reach(found.pixels[number], round(frame)), found.visible[number].mean()
        print(f"({x:.0f}, {y:.0f}) in frame {frame:.0f}: up to {way:.1f} px away, visible in {share:.0%} of the frames")
