"""Where points of tissue and instruments go: as the scene moves, or as its recording shows where that clearly contradicts it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from degense.engine.motion.found_again import clearly_less
from degense.engine.motion.matched import Matched, matching
from degense.engine.progress import Result, Steps, finish
from degense.engine.scene.material_tracks import following_material
from degense.engine.scene.scene import Scene

IN_FRONT = 0.03  # of its distance: a point with a surface so far before it is hidden
DRAWN = 160  # pixels: width of the depth that visibility is read from
CHANGED = 30.0  # grey levels: what is so unlike a point that the recording has lost is another thing


class Tracks(NamedTuple):
    """Points over time."""

    positions: np.ndarray  # float64 [K, T, 3]; world, clip units; NaN for a point that nothing is reconstructed at
    pixels: np.ndarray  # float64 [K, T, 2]; (x, y) in the surgeon's camera of each frame
    visible: np.ndarray  # bool [K, T]; within the frame, and nothing in front


def follow_points(scene: Scene, queries: np.ndarray) -> Tracks:
    """Follow points from where they are seen, forwards and backwards through the whole clip.

    A point moves as the Gaussians of the surface there do (`following_material`). Where the recording is at hand, it is also followed from
    frame to frame (`matching`), as far as that goes, and on from where it is found again; where the places found look clearly more like the
    point than those of the scene, in most of these frames, it is there in all of them, as far away as the surface that the scene has there.
    In other frames the scene goes on.

    It is visible where it is followed by the recording; else where no surface of the scene is in front of it, unless the recording has
    lost it and shows another thing there.

    Parameters
    ----------
    queries : float [K, 3]
        Frame, x and y of each point, pixels.
    """
    return finish(following(scene, queries))


def following(scene: Scene, queries: np.ndarray) -> Steps[Tracks]:
    """`follow_points`, step by step."""
    queries = np.asarray(queries, np.float64).reshape(-1, 3)
    positions = yield from _part(following_material(scene, queries), 0.0, 0.4)
    pixels = _projected(scene, positions)
    if scene.clip is None:
        shown, other = np.zeros(positions.shape[:2], bool), np.zeros(positions.shape[:2], bool)
    else:
        matched = yield from _part(matching(scene.clip.frame, pixels, queries), 0.4, 0.8)
        shown = contradicting(matched) & np.isfinite(positions[..., 0])
        pixels[shown] = matched.pixels[shown]
        other = np.isnan(matched.unlike) & (matched.guessed_unlike > CHANGED)
    visible = yield from _part(_placed(scene, positions, pixels, shown), 0.8, 1.0)
    return Tracks(positions, pixels, visible & ~other)


def contradicting(matched: Matched) -> np.ndarray:
    """Where the recording shows points clearly elsewhere than was guessed, bool [K, T]: in all frames to which it follows a point, if in
    most of them what was guessed is clearly less like it; else in none."""
    known = np.isfinite(matched.unlike)
    elsewhere = clearly_less(matched.guessed_unlike, matched.unlike)
    return known & (2 * (known & elsewhere).sum(1) > known.sum(1))[:, None]


def _projected(scene: Scene, positions: np.ndarray) -> np.ndarray:
    """Pixel positions float64 [K, T, 2] of positions [K, T, 3] in the surgeon's camera of each frame."""
    return np.stack([scene.camera(frame).project(positions[:, frame])[0] for frame in range(scene.frames)], 1)


def _placed(scene: Scene, positions: np.ndarray, pixels: np.ndarray, shown: np.ndarray) -> Steps[np.ndarray]:
    """Put points that are `shown` by the recording, bool [K, T], on the surface at their pixels [K, T, 2], in place.

    Returns which points are within the frame and, if they are not shown, have no surface in front of them, bool [K, T].
    """
    visible = np.zeros(shown.shape, bool)
    for frame in range(scene.frames):
        yield frame / scene.frames, "looking whether they are visible"
        known = np.flatnonzero(np.isfinite(positions[:, frame, 0]))
        camera, found = scene.camera(frame), pixels[known, frame]
        z = camera.project(positions[known, frame])[1]
        small = camera.scaled(min(1.0, DRAWN / camera.width))
        depth = scene.renderer.draw(frame, small, ("depth",))["depth"]
        column, row = np.floor(found * [small.width / camera.width, small.height / camera.height]).astype(np.int64).T
        inside = (z > 0) & (column >= 0) & (column < small.width) & (row >= 0) & (row < small.height)
        surface = depth[np.where(inside, row, 0), np.where(inside, column, 0)]
        moved = shown[known, frame]
        at = np.where(np.isfinite(surface), surface, z)
        positions[known[moved], frame] = camera.unproject(found[moved], at[moved])
        visible[known, frame] = inside & (moved | (z < (1 + IN_FRONT) * surface))
    return visible


def _part(steps: Steps[Result], begin: float, end: float) -> Steps[Result]:
    """Steps as a part of a longer work, from one fraction of it to another."""
    try:
        while True:
            fraction, message = next(steps)
            yield begin + fraction * (end - begin), message
    except StopIteration as stop:
        return stop.value
    finally:
        steps.close()
