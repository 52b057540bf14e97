"""All scores of a run's masks: agreement with annotated ones by every decoder, calibration of the threshold, flicker."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.metrics.calibration import Calibration, ConfidenceCalibration
from degense.engine.metrics.flicker import Flicker
from degense.engine.metrics.masks import MaskScores
from degense.engine.motion import consistent, flow_between, sample
from degense.engine.progress import Progress
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import encode_prompts
from degense.engine.semantics.prompts import DECODERS, DEFAULT_DECODER, DEFAULT_THRESHOLD, PromptSet, PromptVectors

NOT_SCORED = ("background", "black background")
CLOSED = ("argmax", "rnse+argmax")  # closed-set label maps, of the similarities of pixels and of regions
MOST_PAIRS = 16  # of frames that flicker is measured on
LEAST_SIDE = 16  # pixels, that optical flow needs


def score_masks(scene: Scene, clip: Clip, frames: list[int], progress: Progress) -> dict[str, Any]:
    """`miou`, `masks` and `calibration` of one latent, by every decoder and both kinds of similarity.

    On those of `frames` that have a label map, or on all that have one where none of `frames` does (`mask_frames`).
    `miou` and `masks` are of what the window shows: each class a prompt, masks may overlap and leave pixels to no class. `miou_closed`
    and `masks_closed` are of closed-set label maps as the literature scores them: each pixel takes its most similar class, by the
    similarity of a pixel ("argmax") and of its region ("rnse+argmax"). `confidence`: of the masks shown, their pixels and objects.
    """
    labelled = set(clip.labelled_frames)
    scored = [i for i in frames if i in labelled] or sorted(labelled)
    asked = _asked(scene, clip)
    scores, closed = ({name: MaskScores(clip.classes, NOT_SCORED) for name in names} for names in (DECODERS, CLOSED))
    calibrations = {name: Calibration(clip.classes, NOT_SCORED) for name in ("threshold", "rnse")}
    confidence = ConfidenceCalibration()
    for done, i in enumerate(scored):
        progress(done / len(scored), "comparing masks")
        query, labels, valid = scene.query(i), clip.labels(i), clip.valid(i)
        assert labels is not None
        shown = {decoder: query.decode(of_decoder).masks for decoder, of_decoder in asked.items()}
        for decoder, score in scores.items():
            score.add_masks(shown[decoder], labels, valid)
        included = asked[DEFAULT_DECODER].included
        pixels, regions = ([similarity(rows) for rows in included] for similarity in (query.similarity, query.refined))
        for name, similarities in zip(("threshold", "rnse"), (pixels, regions), strict=True):
            for index in calibrations[name].scored:
                calibrations[name].add(index, similarities[index], labels, valid)
        for name, similarities in zip(CLOSED, (pixels, regions), strict=True):
            closed[name].add(closed_set(similarities), labels, valid)
        for index in calibrations["rnse"].scored:
            mask = shown[DEFAULT_DECODER][index]
            confidence.add(query.chances(included[index], asked[DEFAULT_DECODER].classes), mask, index, labels, valid, query.curve)
    results, closed_results = ({name: score.result() for name, score in kind.items()} for kind in (scores, closed))
    return {
        "miou": {decoder: values["miou"] for decoder, values in results.items()},
        "miou_closed": {name: values["miou"] for name, values in closed_results.items()},
        "masks": results,
        "masks_closed": closed_results,
        "mask_frames": scored,
        "mask_frames_trained": [i for i in scored if i not in clip.test_frames],
        "calibration": {name: calibration.result(DEFAULT_THRESHOLD) for name, calibration in calibrations.items()},
        "confidence": confidence.result(),
    }


def closed_set(similarities: Sequence[np.ndarray]) -> np.ndarray:
    """The most similar class of each pixel, uint8 [H, W], of one similarity float32 [H, W] a class; `UNLABELLED` where nothing is drawn."""
    stacked = np.stack(similarities)
    return np.where((stacked != 0).any(0), stacked.argmax(0), UNLABELLED).astype(np.uint8)


def _asked(scene: Scene, clip: Clip) -> dict[str, PromptVectors]:
    """All classes of the clip as prompts, for every decoder."""
    return {decoder: encode_prompts(scene, PromptSet(tuple(clip.classes), decoder=decoder)) for decoder in DECODERS}


def score_flicker(scene: Scene, clip: Clip, frames: list[int], progress: Progress) -> dict[str, Any]:
    """`flicker` by every decoder, between some of `frames` and the frame before each; `flicker_pairs`, how many.

    None where the pictures are too small for optical flow.
    """
    pairs = [i for i in frames if i > 0]
    pairs = [pairs[k] for k in np.unique(np.linspace(0, len(pairs) - 1, min(len(pairs), MOST_PAIRS)).round().astype(int))] if pairs else []
    if min(clip.size) < LEAST_SIDE:
        pairs = []
    asked = _asked(scene, clip)
    scores = {decoder: Flicker() for decoder in DECODERS}
    for done, i in enumerate(pairs):
        progress(done / len(pairs), "measuring flicker")
        here, before = clip.frame(i), clip.frame(i - 1)
        flow = flow_between(here, before)
        arrives = sample(clip.valid(i - 1).astype(np.float32), flow) > 0.99
        reliable = clip.valid(i) & arrives & consistent(flow, flow_between(before, here))
        truths = clip.labels(i - 1), clip.labels(i)
        for decoder, score in scores.items():
            was, is_now = (scene.query(k).decode(asked[decoder]).labels for k in (i - 1, i))
            score.add(was, is_now, flow, reliable, *truths)
    return {"flicker": {decoder: score.value for decoder, score in scores.items()}, "flicker_pairs": len(pairs)}
