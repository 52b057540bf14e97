"""How often the masks of a trained scene are right, found without truth: from the teacher, from what regions of like colour around a place
are called in all frames, and from how often each of the two is right itself (`Consensus.rightness`).

A teacher that is right in a share p of its pixels, wherever the scene may err, agrees with a share p r of those masks of which a share r
is right. One whose mistakes last agrees with more of them, since the scene has learned its mistakes; the regions know other frames.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch

from degense.engine.field import SceneModel
from degense.engine.raster import rasterize
from degense.engine.semantics.masks import query_of
from degense.engine.semantics.masks.confidence import BINS, ConfidenceCurve
from degense.engine.semantics.prompts import PromptVectors
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.semantic.targets import SemanticTargets
from degense.engine.training.semantic.vectors import words_of

MOST_FRAMES = 24  # of the teacher's, evenly spread, that are compared


@torch.no_grad()
def confidence_of(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> ConfidenceCurve | None:
    """How the chance of a pixel to be right grows with its margin, on the teacher's frames; None in clips without classes, or masks.

    `targets` are the teacher's own answers, with its `accuracy` and `rightness`.
    """
    classes = targets.classes
    if classes is None:
        return None
    asked = PromptVectors(tuple(classes), classes=classes)
    words, labelled, sums = words_of(targets.sample, classes), targets.labelled_frames, np.zeros((3, BINS))
    objects: list[np.ndarray] = []  # [n, 2 + BINS] of each mask: share of the picture, right pixels, pixels by bin of the margin
    for frame in (labelled[k] for k in np.unique(np.linspace(0, len(labelled) - 1, min(len(labelled), MOST_FRAMES)).round().astype(int))):
        told = targets.told(frame, words)
        rightness = None if targets.rightness is None else targets.rightness(frame).reshape(*told.shape, -1).cpu().numpy()
        splats = model.at(frames.clip.time(frame)).splats
        drawn = rasterize(splats, torch.cat([splats.colors, splats.semantics], 1), frames.cameras[frame], clean=True)
        query = query_of(drawn, targets.basis)
        for k, mask in enumerate(query.decode(asked).masks):
            held = mask & (told >= 0)
            margin = query.margin(classes[k], classes)[held]
            right_at = (told[held] == k) / targets.accuracy if rightness is None else rightness[held, k]
            place = np.minimum((margin * BINS).astype(int), BINS - 1)
            for row, weight in enumerate((None, margin, right_at)):
                sums[row] += np.bincount(place, weight, BINS)
            count, parts = cv2.connectedComponents(mask.astype(np.uint8))
            share, right = np.bincount(parts[mask], minlength=count) / mask.size, np.bincount(parts[held], right_at, count)
            by_bin = np.bincount(parts[held] * BINS + place, minlength=count * BINS).reshape(count, BINS)
            objects.append(np.column_stack([share, right, by_bin])[1:])
    pixels, margins, right_of_bins = sums
    if not pixels.any():
        return None
    curve = ConfidenceCurve.fitted(pixels, margins, right_of_bins)
    found = np.concatenate(objects)
    found = found[found[:, 2:].any(1)]  # those of which the teacher says anything
    share, right, number = found[:, 0], found[:, 1], found[:, 2:].sum(1)
    said = found[:, 2:] @ curve(margins / np.maximum(pixels, 1)) / number
    return curve.with_objects(share, said, right / number)
