"""How well points of tissue are followed through the clip, against exact tracks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.data.files.point_files import KnownPoints
from degense.engine.progress import finish
from degense.engine.scene import Scene
from degense.engine.scene.material_tracks import following_material
from degense.engine.scene.tracks import Tracks

WITHIN = (4, 8, 16, 32, 64)  # pixels: thresholds of `score_points`, as STIR and SurgT have them
MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0}  # metric units of clips
NEAR = 0.01  # of the picture's width: a point farther from its true pixel position is lost (3.2 pixels of 320)


def score_tracks(predicted: np.ndarray, tracks: np.ndarray, visible: np.ndarray, cameras: Sequence[Camera]) -> dict[str, Any]:
    """Score predicted tracks [K, T, 3] of points, NaN where there are none.

    Protocol
    --------
    `tracks` [K, T, 3] are true positions in the clip's unit and world, `visible` bool [K, T] says where a point is seen, `cameras` are the
    clip's. Points seen at frame 0 are followed from their true position there: errors are of motion alone. Every later frame
    in which such a point is seen counts.

    - `error`, `error_median`: ‖predicted − true‖ over those pairs of point and frame, in the clip's unit; `error_pixels` and
      `error_pixels_median`: distance of their projections. Pairs without a prediction are left out; `coverage` is the share of the others.
    - `within`: share of the pairs whose projection lies within `NEAR` of the width of the true one; without a prediction it does not.
    - `survival`: mean over points of the share of their pairs before the first that is not within.

    A score without pairs is None.
    """
    counted = visible & np.isfinite(tracks).all(-1) & visible[:, :1]
    counted[:, 0] = False
    known = counted & np.isfinite(predicted).all(-1)
    apart = np.full(counted.shape, np.inf)
    for frame, camera in enumerate(cameras):
        here = known[:, frame]
        ends = [camera.project(points[here, frame].astype(np.float64))[0] for points in (predicted, tracks)]
        apart[here, frame] = np.linalg.norm(ends[0] - ends[1], axis=-1)
    errors, within = np.linalg.norm(predicted - tracks, axis=-1), apart <= NEAR * cameras[0].width
    alive = np.logical_and.accumulate(within | ~counted, axis=1) & counted
    followed = counted.any(1)
    return {
        "points": int(np.count_nonzero(followed)),
        "coverage": _mean(known[counted]),
        "error": _mean(errors[known]),
        "error_median": _median(errors[known]),
        "error_pixels": _mean(apart[known]),
        "error_pixels_median": _median(apart[known]),
        "within": _mean(within[counted]),
        "survival": _mean(alive.sum(1)[followed] / counted.sum(1)[followed]),
    }


def score_points(pixels: np.ndarray, visible: np.ndarray, labels: np.ndarray, hidden: np.ndarray) -> dict[str, float | int | None]:
    """Score points [K, T, 2] that were followed from their first label on, by the rules of TAP-Vid with the thresholds of STIR and SurgT.

    Protocol
    --------
    `labels` [K, T, 2] are pixels, NaN where there is none; `hidden` bool [K, T] says where a point is known not to be seen. Counted are
    pairs of point and frame after a point's first label that have a label or are hidden.

    - `delta`: mean over the thresholds `WITHIN` of the share of the labelled pairs that are nearer; `delta_N` for each.
    - `jaccard`: mean over the thresholds of pairs shown as visible and near, over all labelled pairs and what is wrongly shown.
    - `occlusion_accuracy`: share of the pairs that are shown as visible where they have a label, and not where they are hidden.
    - `endpoint_error`, `endpoint_error_median`: distance in labelled pairs, pixels; of points that are followed.
    """
    known = np.isfinite(labels).all(-1)
    later = np.arange(labels.shape[1]) > known.argmax(1)[:, None]
    known, hidden = known & later, hidden & later
    if not known.any():
        return {"pairs": 0}
    apart = np.linalg.norm(pixels - labels, axis=-1)[known]
    apart = np.where(np.isfinite(apart), apart, np.inf)
    near, shown = apart[:, None] < WITHIN, visible[known]
    right, wrong = (near & shown[:, None]).sum(0), (~near & shown[:, None]).sum(0) + visible[hidden].sum()
    shares = near.mean(0)
    return {
        "pairs": int(known.sum()),
        "delta": float(shares.mean()),
        **{f"delta_{limit}": float(share) for limit, share in zip(WITHIN, shares, strict=True)},
        "jaccard": float((right / (len(apart) + wrong)).mean()),
        "occlusion_accuracy": float(np.mean(np.r_[shown, ~visible[hidden]])),
        "endpoint_error": _mean(apart[np.isfinite(apart)]),
        "endpoint_error_median": _median(apart[np.isfinite(apart)]),
    }


def score_followed(pixels: np.ndarray, visible: np.ndarray, known: KnownPoints, width: int) -> dict[str, Any]:
    """`score_points` of pixels [K, T, 2] that were followed from where a file first knows the points (`KnownPoints.queries`).

    Points of which only the ends are known are paired with the nearest. `delta_nothing_moves` is the δ of points that stay where they are;
    `endpoint_error_relative` is the median endpoint error as a share of the picture's `width`.
    """
    paired = known.paired(pixels)
    scores: dict[str, Any] = score_points(pixels, visible, paired.pixels, paired.hidden)
    if not scores["pairs"]:
        return scores
    still = np.repeat(known.queries[:, None, 1:], pixels.shape[1], axis=1)
    resting = known.paired(still)
    scores["delta_nothing_moves"] = score_points(still, np.ones_like(visible), resting.pixels, resting.hidden)["delta"]
    median = scores["endpoint_error_median"]
    scores["endpoint_error_relative"] = median / width if median is not None else None
    return scores


def score_known_points(scene: Scene, found: Tracks, known: KnownPoints) -> dict[str, Any]:
    """`score_points` of points that were followed through a scene from where a file first knows them (`KnownPoints.queries`).

    Beside the scores of `score_followed`: where the clip's depth was measured in a metric unit, `endpoint_error_mm` and
    `endpoint_error_mm_median` are distances in space, of labelled pairs whose depth is known.
    """
    scores, clip, millimetres = (
        score_followed(found.pixels, found.visible, known, scene.clip_size[0]),
        scene.clip,
        MILLIMETRES.get(scene.unit),
    )
    if not scores["pairs"] or clip is None or not clip.depth_measured or millimetres is None:
        return scores
    known = known.paired(found.pixels)
    apart = []
    for frame in range(scene.frames):
        counted = np.isfinite(known.pixels[:, frame]).all(-1) & np.isfinite(known.pixels[:, :frame, 0]).any(1)
        counted &= np.isfinite(found.positions[:, frame]).all(-1)
        depth = depth_at(clip, frame, known.pixels[counted, frame])
        places = scene.camera(frame).unproject(known.pixels[counted, frame], depth)
        apart.append(np.linalg.norm(found.positions[counted, frame] - places, axis=-1)[depth > 0] * millimetres)
    errors = np.concatenate(apart)
    return scores | {"endpoint_error_mm": _mean(errors), "endpoint_error_mm_median": _median(errors)}


def depth_at(clip: Clip, frame: int, places: np.ndarray) -> np.ndarray:
    """Measured depth at pixel positions [..., 2] (of the nearest pixel), clip units; 0 outside and where none is measured."""
    if not clip.depth_measured:
        return np.zeros(places.shape[:-1])
    width, height = clip.size
    column, row = np.moveaxis(np.floor(np.nan_to_num(places, nan=-1.0)).astype(int), -1, 0)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return np.where(inside, clip.depth(frame)[np.where(inside, row, 0), np.where(inside, column, 0)], 0.0)


def still_tracks(tracks: np.ndarray) -> np.ndarray:
    """The answer "nothing moves" [K, T, 3]: every point stays where it is at frame 0."""
    return np.broadcast_to(tracks[:, :1], tracks.shape)


def scene_tracks(scene: Scene, tracks: np.ndarray, visible: np.ndarray, camera: Camera) -> np.ndarray:
    """Tracks [K, T, 3] of the points that are seen at frame 0, as a scene has them; NaN for all others and where nothing is reconstructed.

    What is scored is the reconstruction: a point moves by its Gaussians alone (`following_material`), without the recording that the window
    and `degense track` look at too (`follow_points`). `camera` is the clip's of frame 0.
    """
    predicted = np.full(tracks.shape, np.nan)
    pixels = camera.project(tracks[:, 0].astype(np.float64))[0]
    points = np.flatnonzero(visible[:, 0] & ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(-1))
    found = finish(following_material(scene, np.c_[np.zeros(len(points)), pixels[points]]))
    predicted[points] = tracks[points, :1] + (found - found[:, :1])
    return predicted


def _mean(values: np.ndarray) -> float | None:
    return float(values.mean()) if values.size else None


def _median(values: np.ndarray) -> float | None:
    return float(np.median(values)) if values.size else None
