"""What masks of held-out frames could be at best, if all labels were exact and all motion was known: a ceiling, no baseline."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from degense.engine.clip import UNLABELLED, Clip, Truth
from degense.engine.research.baselines.masks import score_labels

MASK_CEILING = "ceiling: labels of training frames along the true motion"
NEAREST = 2  # training frames whose labels are asked everywhere; others only for what these do not show
POINTS = 4  # of a frame, that vote on a pixel
SPREAD, REACH = 0.5, 2.0  # pixels at the tissue's median depth: standard deviation of a vote's weight, and from where it has none


def mask_ceiling(clip: Clip) -> dict[str, dict[str, Any]]:
    """Scores of `MASK_CEILING` under the keys of `evaluate`; nothing for clips without exact truth and depth, or labels of held-out frames.

    The tissue of a held-out frame is called as the points of the two nearest training frames that lie nearest to its own in the undeformed
    scene, by their weighted vote; where these show no such point, as those of the next training frame that does. An instrument, of whose
    motion there is no truth, keeps the pixels that it truly has if one of the two frames has its class. So what begins between two frames,
    as blood and char, is what costs, and half a pixel at edges.
    """
    truth = clip.truth()
    scored = [frame for frame in clip.test_frames if frame in set(clip.labelled_frames)]
    if truth is None or not clip.depth_measured or not scored or not set(clip.train_frames) <= set(clip.labelled_frames):
        return {}
    return {MASK_CEILING: score_labels(clip, scored, lambda frame: best_labels(clip, truth, frame))}


def best_labels(clip: Clip, truth: Truth, frame: int) -> np.ndarray:
    """The label map uint8 [H, W] of `mask_ceiling`."""
    labels, (places, tissue) = _labels(clip, frame), undeformed(clip, truth, frame)
    pixel = float(np.median(clip.depth(frame)[tissue])) / clip.cameras[frame].fx if tissue.any() else 1.0
    votes, found = np.zeros((*labels.shape, len(clip.classes)), np.float32), np.zeros(labels.shape, bool)
    order = sorted(clip.train_frames, key=lambda other: (abs(other - frame), other))
    for rank, other in enumerate(order):
        asked = tissue if rank < NEAREST else tissue & ~found
        if not asked.any():
            break
        here, shown = undeformed(clip, truth, other)
        said = _labels(clip, other)
        shown &= said != UNLABELLED
        if not shown.any():
            continue
        distance, nearest = cKDTree(here[shown]).query(places[asked], k=POINTS, distance_upper_bound=REACH * pixel)
        weight = np.where(np.isfinite(distance), np.exp(-0.5 * (np.minimum(distance, REACH * pixel) / (SPREAD * pixel)) ** 2), 0)
        of_point = np.append(said[shown], 0)[nearest]  # the last is none, of weight 0
        for value in range(len(clip.classes)):
            votes[asked, value] += (weight * (of_point == value)).sum(1)
        found[asked] |= np.isfinite(distance).any(1)
    best = np.where(found, votes.argmax(-1), UNLABELLED).astype(np.uint8)
    near = np.unique([_labels(clip, other) for other in order[:NEAREST]])
    return np.where(tissue, best, np.where(np.isin(labels, near), labels, UNLABELLED)).astype(np.uint8)


def undeformed(clip: Clip, truth: Truth, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the point that each pixel of a frame shows lies at frame 0, [H, W, 3], and which pixels show tissue, bool [H, W]."""
    depth, moved = clip.depth(frame), truth.displacement[frame]
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
    tissue = np.isfinite(moved[..., 0])
    seen = clip.cameras[frame].unproject(np.stack([columns + 0.5, rows + 0.5], -1), depth)
    return seen - np.where(tissue[..., None], moved, 0), tissue


def _labels(clip: Clip, frame: int) -> np.ndarray:
    labels = clip.labels(frame)
    assert labels is not None
    return labels
