"""Propagation of corrected label maps of a few frames to all others.

A pixel's class is decided by three sources: the Gaussians, labelled by back-projection of the corrected frames and drawn at the other
time (`FieldVotes`; needs a run), the optical flow of the recording (`FlowVotes`), and the appearance of the classes (`AppearanceVotes`).
With F, B and A their shares of class k,

    s_k(p) = log(F_k + ε) + log(B_k + ε) + 2 log(A_k + ε),

and the class of greatest score wins. The field holds large tissue, also where it is hidden; flow follows thin and fast things; appearance
decides where something enters, leaves or changes in place. Islands that are too small for their class go to the next best class.

What no corrected frame shows has no class: with u(p) the chance that a pixel shows such a thing (`unknown_chance`), class k has the chance
(1 − u) softmax_k(s / 1.5), and where u exceeds a tenth the pixel stays unlabelled, since a wrong name is worse than none.
Where the flow leads out of the picture in every corrected frame, and where a scene finds that none of them shows the place (hidden, or
outside), u is at least `OUTSIDE`: tissue that entered later may be of any class, however much it looks like one.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence

import cv2
import numpy as np
from scipy.special import softmax

from degense.engine.annotation.edits import Proposal, pack
from degense.engine.annotation.propagation.votes import AppearanceVotes, FieldVotes, FlowVotes, unknown_chance, unknown_evidence
from degense.engine.clip import UNLABELLED, Clip
from degense.engine.errors import DegenseError
from degense.engine.scene import Scene

FLOOR = 0.02  # ε
APPEARANCE_WEIGHT = 2.0
#: Scores are divided by this before they are taken for log-probabilities: the errors of the three sources are not independent.
SOFTENED = 1.5
#: The chance that a pixel is unknown whose point lies outside of every corrected frame, as flow or a scene has it.
OUTSIDE = 0.9
UNKNOWN_FROM = 0.1  # a pixel with a greater chance to be unknown stays unlabelled
#: An island is dropped below this share of what the class covers in the corrected frames, and of the picture; a class that covers less
#: than the first in a frame altogether is not there.
LEAST_SHARE, SPECK = 0.08, 1e-3
ROUNDS = 4  # of dropping: a dropped island may make another


def propagate(
    clip: Clip,
    corrected: Mapping[int, np.ndarray],
    scene: Scene | None = None,
    frames: Sequence[int] | None = None,
    tell: Callable[[int, np.ndarray, np.ndarray], object] = lambda frame, labels, confidence: None,
) -> Generator[tuple[float, str], None, dict[int, Proposal]]:
    """Propagate label maps to other frames. DegenseError when nothing is corrected, or a map has another size than the clip.

    Parameters
    ----------
    corrected : mapping of frame to uint8 [H, W]
        `UNLABELLED` is propagated like a class.
    scene : Scene, optional
        A run of the clip; without one, flow and appearance decide.
    frames : sequence of int, optional
        Where to, ascending without gaps; default: the whole clip.
    tell : callable, optional
        Takes each frame with its labels, uint8 [H, W], and the chance of each pixel that they are right, float32 [H, W].

    Yields fractions with words, and returns proposals for all `frames` but the corrected ones.
    """
    wanted = list(frames if frames is not None else range(len(clip)))
    values, indices = _indexed(clip, corrected)
    count = len(values)
    yield 0.0, "learning the appearance of the classes"
    appearance = AppearanceVotes([clip.frame(i) for i in indices], list(indices.values()), count)
    field = None
    if scene is not None:
        yield 0.01, "labelling the Gaussians"
        field = FieldVotes(scene, indices, {i: clip.valid(i) for i in indices}, count)
    flow = FlowVotes(clip, indices, count, [min(wanted[0], *indices), max(wanted[-1], *indices)])
    for done, frame in enumerate(flow.measure()):
        yield 0.02 + 0.48 * done / max(1, flow.steps), f"following the motion to frame {frame}"
    usual = _usual_areas(list(indices.values()), count)
    named = count if any((labels == UNLABELLED).any() for labels in corrected.values()) else count - 1  # the last is what is unknown
    result = {}
    for done, frame in enumerate(wanted):
        if frame in indices:
            continue
        yield 0.5 + 0.5 * done / len(wanted), f"propagating labels to frame {frame}"
        rgb = clip.frame(frame)
        scores = np.log(flow.at(frame) + FLOOR) + APPEARANCE_WEIGHT * np.log(appearance.at(rgb) + FLOOR)
        if field is not None:
            scores += np.log(field.at(frame, rgb) * clip.valid(frame)[..., None] + FLOOR)
        chances, strange = softmax(scores / SOFTENED, -1), unknown_chance(unknown_evidence(appearance.novelty(rgb), *flow.traces(frame)))
        outside = flow.outside(frame) if field is None else flow.outside(frame) | (field.outside(frame) & clip.valid(frame))
        strange = np.maximum(strange, OUTSIDE * outside)
        chances *= 1 - strange[..., None]
        chances[..., -1] += strange
        decided = chances.copy()
        decided[strange > UNKNOWN_FROM, -1] = np.inf
        winners = without_islands(decided, usual)
        tell(frame, values[winners], np.take_along_axis(chances, winners[..., None], -1)[..., 0])
        unknown = float(((winners == count - 1) & (strange > UNKNOWN_FROM)).mean())
        result[frame] = Proposal(pack(values[winners]), winners.shape, expected_iou(chances[..., :named], winners), unknown)
    return result


def _indexed(clip: Clip, corrected: Mapping[int, np.ndarray]) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """The values that occur and, last, `UNLABELLED`, uint8 [count], and which of them each pixel of a corrected frame has, int64 [H, W]."""
    if not corrected:
        raise DegenseError("No frame is labelled yet; label one, and its labels can be propagated to the others.")
    width, height = clip.size
    for frame, labels in corrected.items():
        if labels.shape != (height, width):
            found = f"{labels.shape[1]} × {labels.shape[0]}"
            raise DegenseError(f"The label map of frame {frame} is {found} pixels, but the clip is {width} × {height}; scale it first.")
    values = np.unique(np.concatenate([[UNLABELLED], *(np.unique(labels) for labels in corrected.values())]).astype(np.uint8))
    if values.tolist() == [UNLABELLED]:
        raise DegenseError("The corrected frames hold no label; paint one, and it can be propagated to the others.")
    return values, {frame: np.searchsorted(values, corrected[frame]).astype(np.int64) for frame in sorted(corrected)}


def _usual_areas(indices: Sequence[np.ndarray], count: int) -> np.ndarray:
    """Pixels of each class in a corrected frame that has it, float [count]; of what has no label, a speck makes an island."""
    areas = np.stack([np.bincount(index.ravel(), minlength=count) for index in indices])
    usual = areas.sum(0) / np.maximum((areas > 0).sum(0), 1)
    usual[-1] = SPECK * indices[0].size / LEAST_SHARE
    return usual


def without_islands(scores: np.ndarray, usual: np.ndarray) -> np.ndarray:
    """The class of greatest score in each pixel, int64 [H, W], of scores [H, W, count], where it makes more than a speck."""
    scores = scores.copy()
    for _ in range(ROUNDS):
        winners = scores.argmax(-1)
        dropped = np.zeros(winners.shape, bool)
        for index, area in enumerate(usual):
            mask = (winners == index).astype(np.uint8)
            total = np.count_nonzero(mask)
            if not total:
                continue
            _, parts, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
            small = stats[:, cv2.CC_STAT_AREA] < (np.inf if total < LEAST_SHARE * area else min(LEAST_SHARE * area, SPECK * mask.size))
            small[0] = False
            here = small[parts]
            scores[here, index] = -np.inf
            dropped |= here
        if not dropped.any():
            break
    return scores.argmax(-1)


def expected_iou(chances: np.ndarray, winners: np.ndarray) -> float:
    """Mean over the classes in `winners` [H, W] of Σ_{won} P / (|won| + Σ_{not won} P), with P the chances [H, W, classes]; values beyond
    these classes are none. 0 without any."""
    each = []
    for index in np.unique(winners[winners < chances.shape[-1]]):
        won, chance = winners == index, chances[..., index]
        right = chance[won].sum()
        each.append(right / (np.count_nonzero(won) + chance.sum() - right))
    return float(np.mean(each)) if each else 0.0
