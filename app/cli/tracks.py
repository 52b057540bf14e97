"""`degense track`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.app.cli.terminal import Bar, run_steps, table
from degense.app.features.tracks.tracks import reach, tracks_json, without_recording
from degense.engine.errors import DegenseError
from degense.engine.files import write_text

if TYPE_CHECKING:
    from degense.engine.data.files.point_files import KnownPoints
    from degense.engine.scene.tracks import Tracks

MOST_SAID = 20  # points that are told one by one


def track(options: argparse.Namespace) -> None:
    """Follow points through a run or a clip: say where they go, and how near that is to what a file knows of them."""
    from degense.engine.metrics.tracks import score_followed, score_known_points
    from degense.engine.scene import Scene
    from degense.engine.scene.tracks import Tracks, following

    if (options.path / "run.json").is_file():
        scene = Scene.open(options.path)
        unit = scene.unit
        queries, known = _wanted(options, scene.frames, scene.clip_size)
        found = run_steps(following(scene, queries), Bar())
        said = without_recording(scene)
        scores: dict[str, Any] = score_known_points(scene, found, known) if known else {}
    else:
        from degense.engine.data.readers import open_clip
        from degense.engine.motion.points import following_pixels

        clip, said = open_clip(options.path), ""
        unit = clip.unit
        queries, known = _wanted(options, len(clip), clip.size)
        pixels, seen = run_steps(following_pixels(clip.frame, len(clip), queries), Bar())
        found = Tracks(np.full((*seen.shape, 3), np.nan), pixels, seen)
        scores = score_followed(pixels, seen, known, clip.size[0]) if known else {}
    if options.json is not None:
        write_text(options.json, tracks_json(unit, queries, found, scores))
    if said:
        print(said)
    _say(queries, found)
    if scores.get("pairs"):
        print(table(scores))


def _wanted(options: argparse.Namespace, frames: int, size: tuple[int, int]) -> tuple[np.ndarray, KnownPoints | None]:
    """The queries of the file or grid that was asked for, float64 [K, 3], and what the file knows."""
    from degense.engine.data.files.point_files import read_points

    if options.points is not None:
        known = read_points(options.points, frames, size)
        return known.queries, known
    if not 0 <= options.frame < frames:
        raise DegenseError(f"There is no frame {options.frame}; the frames are 0 to {frames - 1}.")
    x, y = np.meshgrid(*((np.arange(options.grid) + 0.5) / options.grid * side for side in size))
    return np.c_[np.full(x.size, options.frame), x.ravel(), y.ravel()], None


def _say(queries: np.ndarray, found: Tracks) -> None:
    followed = np.isfinite(found.pixels).all((1, 2))
    print(f"{followed.sum()} of {len(queries)} points followed; nothing is reconstructed at the others")
    for number in np.flatnonzero(followed)[:MOST_SAID]:
        frame, x, y = queries[number]
        way, share = reach(found.pixels[number], round(frame)), found.visible[number].mean()
        print(f"({x:.0f}, {y:.0f}) in frame {frame:.0f}: up to {way:.1f} px away, visible in {share:.0%} of the frames")
