"""Camera poses from the frames of a clip, and whether they explain the motion well enough to be used."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.data.poses.bundle import projected, refine
from degense.engine.data.poses.tracks import SIDE, Lost, Track, Views, close_loops, follow_tissue
from degense.engine.progress import Progress, silent

NOTICED = 1.5  # pixels of a reduced frame: tracks whose median motion is smaller are not used to judge the poses
STAYS = 0.7  # pixels: a point that is never farther from its place stands still
EXPLAINS = 0.75  # share of the motion seen that a moving camera must explain
STATIC_AREA = 0.03  # share of the tissue that may stand still all the while although the camera moves


@dataclass(frozen=True)
class PoseEstimate:
    """Estimated poses and how well they explain the frames."""

    viewmats: np.ndarray  # float64 [T, 4, 4]; world to camera in the clip's unit; the world is the camera of frame 0
    travel: float  # the farthest that the camera gets from where it was at frame 0, clip units
    turn: float  # the most that it turns from there, degrees
    #: Share of the motion seen that these poses explain: 1 − Σ r / Σ f over the tracks in which something moves, f being the median length
    #: of the way that points went, r the median distance between where they are seen and where the poses put them. Pixels.
    explained: float
    #: Share of the tissue that never leaves its place in the picture by more than a pixel, though something moves. A camera that moves
    #: leaves no such area.
    static_area: float

    @property
    def doubt(self) -> str:
        """Why the camera is rather taken to stand still; empty when it moves."""
        if self.explained == 0:
            return "hardly anything moves"
        if self.static_area > STATIC_AREA:
            return f"{100 * self.static_area:.0f} % of the tissue never leaves its place in the picture"
        if self.explained < EXPLAINS:
            return f"a moving one would explain only {100 * self.explained:.0f} % of the motion seen"
        return ""


def estimate_poses(clip: Clip, progress: Progress = silent, *, labelled: bool = False) -> PoseEstimate:
    """Estimate the pose of every frame from the training frames.

    Points of key frames with depth are followed by optical flow (masked pixels, reflections and plain surfaces left out), and all poses
    are fitted at once so that one rigid motion explains most of them; what it does not explain is left to deformation. Held-out frames
    are never read: their poses, and those of frames that show nothing, follow from their neighbours' by least acceleration. With
    `labelled`, what the label maps of training frames call an instrument is left out too; else instruments are among what the one motion
    does not explain. Deterministic.

    With measured depth the poses are metric. With a prior they are in its unit, and its errors of shape turn into errors of the poses.

    What it cannot tell apart: motion of the camera from motion that all tissue shares. Breathing that lifts nearly everything alike is
    taken for the camera's, and what stands still meanwhile is then seen to move against it. Where tissue is flat and the view narrow, a
    turn of the camera hardly differs from a shift. Lost when the frames do not say; in words.
    """
    frames = clip.train_frames
    if len(frames) < 2:
        raise Lost("a single frame shows no motion")
    views = Views(clip, frames[0], labelled)
    if min(views.size) < SIDE:
        raise Lost(f"pictures of {clip.size[0]} × {clip.size[1]} are too small to follow tissue in them")
    keys, tracks = follow_tissue(views, frames, progress)
    viewmats = refine(np.tile(np.eye(4), (len(clip), 1, 1)), tracks, views.camera)
    if closing := close_loops(keys, viewmats, progress):
        tracks = tracks + closing
        viewmats = refine(viewmats, tracks, views.camera)
    explained, static_area = _judge(tracks, viewmats, views.camera)
    centres = -np.einsum("tji,tj->ti", viewmats[:, :3, :3], viewmats[:, :3, 3]) / views.unit
    turn = float(np.degrees(Rotation.from_matrix(viewmats[:, :3, :3]).magnitude().max()))
    viewmats[:, :3, 3] /= views.unit
    return PoseEstimate(viewmats, float(np.linalg.norm(centres, axis=1).max()), turn, explained, static_area)


def _judge(tracks: list[Track], viewmats: np.ndarray, camera: Camera) -> tuple[float, float]:
    """`explained` and `static_area`; both 0 when hardly anything moves."""
    way = residual = 0.0
    stays: dict[int, list[np.ndarray]] = {}
    for track in tracks:
        went = np.linalg.norm(track.seen - track.pixels, axis=1)
        if np.median(went) < NOTICED:
            continue
        way += float(np.median(went))
        residual += float(np.median(np.linalg.norm(projected(viewmats, track, camera) - track.seen, axis=1)))
        stays.setdefault(track.key, []).append(np.stack([track.index, went < STAYS]))
    if way == 0:
        return 0.0, 0.0
    shares, weights = [], []
    for found in stays.values():
        index, there = np.concatenate(found, axis=1)
        count = np.bincount(index)
        often = count >= max(1, len(found) / 2)
        shares.append(float((np.bincount(index, there)[often] >= 0.9 * count[often]).mean()) if often.any() else 0.0)
        weights.append(len(found))
    return max(0.0, 1 - residual / way), float(np.average(shares, weights=weights))


def find_cameras(clip: Clip, progress: Progress = silent, *, labelled: bool = False) -> Clip:
    """The clip with its cameras found, when it wishes so (`Clip.poses`); its provenance says what came of it.

    "auto" keeps the camera still unless a moving one explains at least three quarters of the motion seen and no area stands still.
    `labelled` is whether label maps of training frames may be read for where instruments are: only for a training whose teacher they are.
    """
    if clip.poses == "given":
        return clip
    try:
        found = estimate_poses(clip, progress, labelled=labelled)
    except Lost as reason:
        return with_cameras(clip, clip.cameras, f"assumed: the camera stands still; {reason}")
    if clip.poses == "auto" and found.doubt:
        return with_cameras(clip, clip.cameras, f"assumed: the camera stands still; {found.doubt}")
    words = f"estimated: the camera moves up to {found.travel:.2g} {clip.unit} and {found.turn:.1f}°, which explains "
    words += f"{100 * found.explained:.0f} % of the motion seen"
    if not clip.depth_measured:
        words += "; lengths follow the depth prior"
    if clip.poses == "estimate" and found.doubt:
        words += f"; it may stand still: {found.doubt}"
    cameras = [replace(camera, viewmat=viewmat) for camera, viewmat in zip(clip.cameras, found.viewmats, strict=True)]
    return with_cameras(clip, cameras, words)


def with_cameras(clip: Clip, cameras: list[Camera], words: str) -> Clip:
    """The same clip seen by other cameras; `words` for `provenance["poses"]`. The given one is not changed."""
    posed = copy.copy(clip)
    posed.cameras, posed.provenance, posed.poses = cameras, clip.provenance | {"poses": words}, "given"
    return posed
