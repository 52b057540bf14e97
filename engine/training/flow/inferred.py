"""Motion of tissue that does not show its own: the share of the motion around it that it had while it showed it.

Where tissue chars or bleeds, no match is evidence, and smoothness alone would carry the motion around into a burn that stands still. But
the frames before show how it moves: tissue that stood still while all around it breathed stands still, and tissue that moved with its
surroundings goes on with them.
"""

from __future__ import annotations

import cv2
import numpy as np
import torch

from degense.engine.motion import sample
from degense.engine.motion.constancy import around, log_intensity, looks_changed
from degense.engine.motion.surroundings import from_around
from degense.engine.progress import Progress, silent
from degense.engine.threads import made_ahead
from degense.engine.training.flow.supervision import FlowSupervision, Pair, from_nearest, precision_of
from degense.engine.training.frames import TrainingFrames

REACH = 0.03  # of the width: σ of the window in which tissue has one share
RARE = 0.75  # of the median share of frames in which tissue is seen: what is seen in fewer is inferred, and is no surroundings
ROUGH = 0.025  # of the width: σ of the window in which motion is smooth, so that what is rough is error
LEAST = 0.03  # pixels: error that any flow has
PRIOR = 50.0  # Σ s·s / σ², the motion around over its error, at which half of the share is believed
NEITHER = 0.25  # of a share: below it tissue stands still, and from 1 less it on it moves along
UNSURE = 0.02  # precision below which nothing is inferred
STEPS = 4  # of the inversion of a flow field
THREADS = 4  # that frames are shared out to


def inferred_pairs(flow: FlowSupervision, progress: Progress = silent) -> dict[tuple[int, int], Pair]:
    """Pairs with the first training frame, by their two frames, completed where tissue looks other than in it and no flow is seen.

    With r(p, t) the flow from the first frame less what the camera alone makes of it, and s(p, t) the same by what is often seen around
    (`from_around`), a place moves by α s where its motion is not seen,

        α = (G(Σ_t r·s / σ²) / (G(Σ_t s·s / σ²) + `PRIOR`) − `NEITHER`) / (1 − 2 `NEITHER`),    0 ≤ α ≤ 1,

    sums over the frames in which it is seen, G a Gaussian mean, σ the flow's own `roughness`: a share that is nearly none or all is none or
    all. Its precision is E `precision_of`(α spread), where E = 1 − `PRIOR` / (G(Σ_t s·s / σ²) + `PRIOR`) says whether there was enough
    motion around to tell, and the spread how much that varies from place to place.
    """
    first, *others = flow.frames.clip.train_frames
    seen = [flow.seen(first, frame) for frame in others]
    frequency = np.stack(seen).mean(0)
    typical = np.median(frequency[flow.tissue[first]]) if flow.tissue[first].any() else 0.0
    often = frequency >= RARE * typical
    share, evidence = _share(flow, seen, often, progress)
    look = log_intensity(flow.image(first))

    def inferred(number: int) -> dict[tuple[int, int], Pair]:
        frame, known = others[number], seen[number]
        camera = camera_flow(flow.frames, first, frame, flow.size)
        near, spread = from_around(flow.flow(first, frame) - camera, known & often)
        out = camera + share[..., None] * near
        back = inverse(out, camera_flow(flow.frames, frame, first, flow.size))
        changed = ~often & around(looks_changed(look, log_intensity(flow.image(frame)), out))
        precision = np.where(changed, evidence * precision_of(share * spread), 0).astype(np.float32)
        found: dict[tuple[int, int], Pair] = {}
        for here, there, way, sure in ((first, frame, out, precision), (frame, first, back, sample(precision, back))):
            ends = flow.tissue[here] & (sample(flow.tissue[there].astype(np.float32), way) > 0.99)
            missing = ends & (sure > UNSURE) & ~flow.seen(here, there)
            if missing.any():
                found[here, there] = _completed(flow, here, there, way, sure, missing)
        return found

    all_found: dict[tuple[int, int], Pair] = {}
    for count, found in enumerate(made_ahead(inferred, range(len(others)), THREADS), start=1):
        progress(0.3 + 0.7 * count / len(others), "inferring the motion of tissue that changes its look")
        all_found |= found
    return all_found


def _share(flow: FlowSupervision, seen: list[np.ndarray], often: np.ndarray, progress: Progress) -> tuple[np.ndarray, np.ndarray]:
    """α and E of `inferred_pairs`, float32 [h, w] both."""
    first, *others = flow.frames.clip.train_frames

    def evidence(number: int) -> tuple[np.ndarray, np.ndarray]:
        frame, known = others[number], seen[number]
        motion = flow.flow(first, frame) - camera_flow(flow.frames, first, frame, flow.size)
        own = np.where(known[..., None], motion, 0)
        near, _ = from_around(own, known & often)
        precision = known / (roughness(own, known) ** 2 + LEAST**2)
        return precision * (own * near).sum(-1), precision * (near * near).sum(-1)

    together, alone = np.zeros((2, *often.shape), np.float32)
    for count, (of_both, of_one) in enumerate(made_ahead(evidence, range(len(others)), THREADS)):
        progress(0.3 * count / len(others), "learning how tissue moves with its surroundings")
        together += of_both
        alone += of_one
    together, alone = (cv2.GaussianBlur(total, (0, 0), REACH * often.shape[1]) for total in (together, alone))
    return np.clip((together / (alone + PRIOR) - NEITHER) / (1 - 2 * NEITHER), 0, 1), alone / (alone + PRIOR)


def _completed(flow: FlowSupervision, here: int, there: int, way: np.ndarray, precision: np.ndarray, missing: np.ndarray) -> Pair:
    """A pair with another flow [h, w, 2] and its precision [h, w] where its own is `missing`, bool [h, w]."""
    pair = flow.pair(here, there)
    assert pair is not None
    there_is_none = torch.from_numpy(missing[None]).to(pair.flow.device)
    relative, sure = np.nan_to_num(way / np.array(flow.size, np.float32)).transpose(2, 0, 1), np.nan_to_num(precision)[None]
    inferred = [torch.from_numpy(np.ascontiguousarray(values)).to(pair.flow) for values in (relative, missing[None], sure)]
    kept = pair.flow, pair.weight, pair.precision
    return Pair(there, *(torch.where(there_is_none, new, old) for new, old in zip(inferred, kept, strict=True)))


def roughness(flow: np.ndarray, known: np.ndarray) -> np.ndarray:
    """How far flow [h, w, 2] is from its own mean around, where it is `known`, root mean square, pixels, float32 [h, w].

    Tissue moves smoothly, also where its motion changes from place to place at a steady rate, which its mean follows: what is rough is
    mostly error.
    """
    sigma, weight = ROUGH * flow.shape[1], known.astype(np.float32)
    total = np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-3)
    mean = cv2.GaussianBlur(flow * weight[..., None], (0, 0), sigma) / total[..., None]
    return np.sqrt(cv2.GaussianBlur(np.square(flow - mean).sum(-1) * weight, (0, 0), sigma) / total)


def camera_flow(frames: TrainingFrames, here: int, there: int, size: tuple[int, int]) -> np.ndarray:
    """Flow between two frames of tissue that stands still, by depth and cameras, float32 [h, w, 2], pixels at this `size`."""
    start, end = (frames.cameras[i].scaled(size[0] / frames.size[0]) for i in (here, there))
    depth = cv2.resize(frames.depth(here), size, interpolation=cv2.INTER_NEAREST)
    depth = from_nearest(depth, depth > 0)
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    pixels = np.stack([x, y], -1).reshape(-1, 2)
    moved = end.project(start.unproject(pixels, depth.reshape(-1)))[0] - pixels
    return moved.reshape(size[1], size[0], 2).astype(np.float32)


def inverse(flow: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Flow b → a of flow a → b [h, w, 2], by fixed-point iteration from a guess; NaN where its way leaves the image."""
    back = start
    for _ in range(STEPS):
        back = -sample(flow, back)
    return back
