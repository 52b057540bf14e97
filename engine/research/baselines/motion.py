"""Motion without any scene: "nothing moves", and optical flow lifted to 3D with the clip's depth."""

from __future__ import annotations

from typing import Any

import numpy as np

from degense.engine.clip import Clip, Truth
from degense.engine.metrics.motion import MotionScores, scene_depth
from degense.engine.metrics.tracks import depth_at, score_tracks, still_tracks
from degense.engine.motion import consistent
from degense.engine.research.baselines.clip_flow import ClipFlow


def motion_baselines(clip: Clip, flow: ClipFlow) -> dict[str, dict[str, Any]]:
    """Scores of "nothing moves" and "chained optical flow" on all frames, as runs are scored; empty without exact truth.

    Where the flow is not consistent forwards and backwards, what it says is marked as a guess.
    """
    truth = clip.truth()
    if truth is None:
        return {}
    depth = scene_depth(clip)
    still, lifted = MotionScores(depth), MotionScores(depth)
    for frame in range(len(clip)):
        still.add(np.zeros(clip.size[::-1]), truth.displacement[frame], truth.cautery[frame])
        guess = ~consistent(*flow.from_first[frame - 1][::-1]) if frame else None
        lifted.add(lifted_displacement(clip, flow, frame), truth.displacement[frame], truth.cautery[frame], guess)
    found = {"nothing moves": still.result(), "chained optical flow": lifted.result()}
    if truth.tracks is not None and truth.visible is not None:
        predicted = {"nothing moves": still_tracks(truth.tracks), "chained optical flow": lifted_tracks(clip, flow, truth)}
        for name, points in predicted.items():
            found[name]["tracks"] = score_tracks(points, truth.tracks, truth.visible, clip.cameras)
    return found


def lifted_displacement(clip: Clip, flow: ClipFlow, frame: int) -> np.ndarray:
    """Displacement since frame 0 of what each pixel of a frame shows, float64 [H, W, 3], clip units: the way that optical flow leads back,
    with the measured depth at both ends. Where one end has none it is taken for as far as the other, else for as far as the scene."""
    pixels = clip.cameras[frame].pixel_centres()
    if frame == 0:
        return np.zeros((*clip.size[::-1], 3))
    origin = pixels + flow.from_first[frame - 1][1]
    here = depth_at(clip, frame, pixels)
    there = depth_at(clip, 0, origin)
    far = scene_depth(clip) or 1.0
    here = np.where(here > 0, here, np.where(there > 0, there, far))
    there = np.where(there > 0, there, here)
    return clip.cameras[frame].unproject(pixels, here) - clip.cameras[0].unproject(origin, there)


def lifted_tracks(clip: Clip, flow: ClipFlow, truth: Truth) -> np.ndarray:
    """Tracks [K, T, 3] of points that flow leads from their pixel in frame 0, at the depth measured where it leads to."""
    assert truth.tracks is not None
    start, depth = clip.cameras[0].project(truth.tracks[:, 0].astype(np.float64))
    predicted = truth.tracks.astype(np.float64).copy()
    width, height = clip.size
    column, row = (np.clip(np.floor(start[:, axis]), 0, most - 1).astype(int) for axis, most in enumerate((width, height)))
    for frame in range(1, len(clip)):
        end = start + flow.from_first[frame - 1][0][row, column]
        found = depth_at(clip, frame, end)
        predicted[:, frame] = clip.cameras[frame].unproject(end, np.where(found > 0, found, depth))
    return predicted
