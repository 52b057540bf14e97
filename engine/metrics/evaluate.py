"""All scores of a run on its held-out frames."""

from __future__ import annotations

import statistics
import time
from collections.abc import Collection
from typing import Any

import numpy as np
import torch

from degense.engine.clip import Clip, Truth
from degense.engine.errors import ClipError
from degense.engine.layers import LAYERS, LayerRequest
from degense.engine.metrics.averages import Mean
from degense.engine.metrics.image import ImageScores
from degense.engine.metrics.inspection import InspectionScores, true_motion
from degense.engine.metrics.motion import MotionScores, scene_depth
from degense.engine.metrics.semantics import score_flicker, score_masks
from degense.engine.metrics.tracks import scene_tracks, score_tracks, still_tracks
from degense.engine.motion.observed import ObservedMotion, contradicted
from degense.engine.progress import Progress, silent
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import encode_prompts
from degense.engine.semantics.prompts import PromptSet

TIMED = 20
PARTS = ("masks", "flicker", "motion", "inspection", "speed")


def evaluate(scene: Scene, clip: Clip, progress: Progress = silent, parts: Collection[str] = PARTS) -> dict[str, Any]:
    """Score a run: its pictures, and all of the rest or some `parts` of it.

    Protocol
    --------
    Images and masks: held-out frames, (i − 1) % 8 == 0, never trained on; all frames when the clip is too short to hold any out (then
    `held_out` is False). Masks count only frames that have a label map; a clip whose only label map was trained on is scored on that one
    and says so (`mask_frames_trained`). `miou` per decoder as in `MaskScores`, of the masks that the window shows when all classes are
    prompts; `miou_closed` of closed-set label maps, as in `score_masks`; `calibration` as in `Calibration`; `flicker` as in `Flicker`,
    between held-out frames and the frame before each. Motion: every frame and every displayed pixel, where the clip brings exact truth,
    in the clip's unit, as in `MotionScores`; point tracks, where it brings any, as in `score_tracks`; `inspection` as in
    `InspectionScores`, where it measured depth too. `uncertain_share`: share of valid pixels, all frames but the reference, whose
    displacement is marked as a guess; None for a run without observability.

    Returns
    -------
    dict
        `poses` (where the cameras come from, in words), image scores, `miou` {decoder: value}, `masks` {decoder: all scores}, motion
        scores, `train_seconds`, `gaussians`, `render_fps` (baked states, colour only, this machine), `query_ms` (warm frame, prompt to
        mask) and `query_new_frame_ms`; `moving`, how many Gaussians the field changes (None for runs of earlier versions);
        `teacher_disagreement`, the share of pixels that the teacher calls otherwise than the consensus of its frames (None without one).

    Raises
    ------
    ClipError
        When the clip has another size or length than the run.
    """
    if clip.size != scene.clip_size or len(clip) != scene.frames:
        raise ClipError(
            f"{clip.path} has {len(clip)} frames of {clip.size}, but {scene.name} was trained on {scene.frames} of {scene.clip_size}"
        )
    frames = clip.test_frames or list(range(len(clip)))
    result = _facts(scene, clip, frames)
    images = ImageScores()
    for done, i in enumerate(frames):
        progress(0.4 * done / len(frames), "comparing pictures")
        images.add(scene.render_rgb(i), clip.frame(i), clip.valid(i))
    result |= images.result()
    if scene.has_semantics and clip.labelled_frames:
        if "masks" in parts:
            result |= score_masks(scene, clip, frames, lambda f, words: progress(0.4 + 0.2 * f, words))
        if "flicker" in parts:
            result |= score_flicker(scene, clip, frames, lambda f, words: progress(0.6 + 0.1 * f, words))
    truth = clip.truth() if {"motion", "inspection"} & set(parts) else None
    if "motion" in parts:
        result |= _score_motion(scene, clip, truth, lambda f, words: progress(0.7 + 0.1 * f, words))
    if "inspection" in parts:
        result |= _score_inspection(scene, clip, truth, lambda f, words: progress(0.8 + 0.1 * f, words))
    result |= {"train_seconds": scene.run.info["train_seconds"], "gaussians": len(scene.model)}
    if "speed" in parts:
        progress(0.9, "measuring speed")
        result |= {"render_fps": _render_fps(scene)} | _query_times(scene)
    return result


def _facts(scene: Scene, clip: Clip, frames: list[int]) -> dict[str, Any]:
    """What was scored, and how the run was made."""
    return {
        "run": scene.name,
        "clip": clip.name,
        "frames": frames,
        "held_out": bool(clip.test_frames),
        "routing": scene.run.info["config"]["routing"],
        "preset": scene.run.info["config"]["preset"],
        "unit": scene.unit,
        "poses": scene.run.info.get("provenance", {}).get("poses"),
        "moving": scene.run.info.get("moving"),
        "teacher_disagreement": scene.run.info.get("teacher", {}).get("disagreement"),
    }


def _score_motion(scene: Scene, clip: Clip, truth: Truth | None, progress: Progress) -> dict[str, Any]:
    """`uncertain_share`, and motion scores where the clip brings exact truth."""
    displacement, share, motion = LAYERS["displacement"], Mean(), MotionScores(scene_depth(clip))
    for i in range(len(clip)):
        progress(i / len(clip), "comparing motion")
        request = LayerRequest(i)
        uncertain = displacement.uncertain(scene, request)
        if uncertain is not None and (valid := clip.valid(i)).any():
            share.add(float(uncertain[valid].mean()), float(valid.sum()))
        if truth is not None:
            observability = scene.render(i, None, ("observability",))["observability"] if uncertain is not None else None
            motion.add(displacement.pixels(scene, request), truth.displacement[i], truth.cautery[i], uncertain, observability)
    found = {"uncertain_share": share.value} | (motion.result() if truth is not None else {})
    if truth is None or truth.tracks is None or truth.visible is None:
        return found
    predicted = {
        "tracks": scene_tracks(scene, truth.tracks, truth.visible, clip.cameras[0]),
        "tracks_nothing_moves": still_tracks(truth.tracks),
    }
    return found | {name: score_tracks(points, truth.tracks, truth.visible, clip.cameras) for name, points in predicted.items()}


def _score_inspection(scene: Scene, clip: Clip, truth: Truth | None, progress: Progress) -> dict[str, Any]:
    """`inspection`: the warp layer as a detector of wrong motion, where the clip brings exact truth and depth."""
    if truth is None or not clip.depth_measured:
        return {}
    observed, scores = ObservedMotion(clip, scene.reference_frame), InspectionScores()
    for i in range(len(clip)):
        progress(i / len(clip), "inspecting motion")
        modelled = scene.render(i, None, ("motion",))["motion"]
        scores.add(contradicted(modelled, observed.at(i)), modelled, true_motion(clip, truth.displacement[i], i))
    return {"inspection": scores.result()}


def _render_fps(scene: Scene) -> float:
    """Frames a second from baked states, colour only, to an array in memory."""
    frames = np.linspace(0, scene.frames - 1, min(scene.frames, TIMED)).round().astype(int)
    for i in frames:
        scene.splats(i)
    seconds = []
    for i in frames:
        start = time.perf_counter()
        scene.renderer.draw(i, scene.camera(i), ("rgb",))
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        seconds.append(time.perf_counter() - start)
    return 1 / statistics.median(seconds)


def _query_times(scene: Scene) -> dict[str, float | None]:
    """Milliseconds from prompt to final mask (decoder rnse): on a frame not seen before, and another prompt on the same frame."""
    if not scene.has_semantics or not scene.classes:
        return {"query_ms": None, "query_new_frame_ms": None}
    first, warm = [], []
    frames = np.linspace(0, scene.frames - 1, min(scene.frames, 5)).round().astype(int)
    asked = [encode_prompts(scene, PromptSet((name,))) for name in scene.classes[:2]]
    for i in frames:
        scene.splats(i, semantics=True)
        start = time.perf_counter()
        query = scene.renderer.new_query(i, scene.camera(i))
        query.decode(asked[0])
        first.append(time.perf_counter() - start)
        start = time.perf_counter()
        query.decode(asked[-1])
        warm.append(time.perf_counter() - start)
    return {"query_ms": statistics.median(warm) * 1e3, "query_new_frame_ms": statistics.median(first) * 1e3}
