"""What the processes of a sweep over real clips do: measure flow, train and score, score baselines."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from degense.engine.clip import Clip
from degense.engine.data.files.point_files import KnownPoints, points_beside, read_points
from degense.engine.data.readers import open_clip
from degense.engine.progress import silent
from degense.engine.research.baselines.clip_flow import ClipFlow
from degense.engine.research.baselines.images import image_baselines
from degense.engine.research.baselines.masks import mask_baselines
from degense.engine.research.baselines.points import point_baselines
from degense.engine.research.real_clips.held_out_maps import read_held_out_maps, score_first_map, score_scene_maps
from degense.engine.research.real_clips.plan import ClipJob, ClipsPlan, RealClip
from degense.engine.research.sweep.work import trained
from degense.engine.semantics.teachers import default_teacher
from degense.engine.store.files import write_json
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames

if TYPE_CHECKING:
    from degense.engine.scene import Scene


def prepare_clip(plan: ClipsPlan, scene: RealClip) -> None:
    """Measure the flow between the training frames of a clip, which its trainings share (`share_flow`)."""
    configs = [plan.config(method, 0) for method in plan.methods]
    if flowing := [config for config in configs if config.flow > 0]:
        clip = open_clip(scene.path)
        FlowSupervision(TrainingFrames(clip, flowing[0].max_pixels, torch.device("cpu")), constancy=False)


def score_job(plan: ClipsPlan, job: ClipJob) -> dict[str, Any]:
    """Train one job with the teacher that the clip has, and score it; `tracks` where points are marked, `held_out_maps` where maps are."""
    from degense.engine.metrics.evaluate import evaluate
    from degense.engine.metrics.tracks import score_known_points
    from degense.engine.scene.tracks import follow_points

    started, clip = time.perf_counter(), open_clip(job.scene.path)
    teacher, known = default_teacher(clip), marked_points(clip)
    with trained(clip, plan.out / "runs" / job.name, plan.config(job.method, job.seed), teacher) as scene:
        begun = time.perf_counter()
        scores = evaluate(scene, clip, parts=("masks",) if held_out_labels(clip) else ()) | clip_facts(scene, clip, teacher)
        if known is not None:
            found = follow_points(scene, known.queries)
            followed = float(np.isfinite(found.pixels).all((1, 2)).mean())
            scores["tracks"] = score_known_points(scene, found, known) | {"points": len(known.queries), "followed": followed}
        if job.scene.maps is not None and scene.has_semantics:
            scores["held_out_maps"] = score_scene_maps(scene, clip, read_held_out_maps(job.scene.maps, clip))
        return scores | {"job_seconds": time.perf_counter() - started, "score_seconds": time.perf_counter() - begun}


def baseline_files(plan: ClipsPlan, scene: RealClip) -> list[Path]:
    """Where the baselines of a clip are kept."""
    return [plan.out / "baselines" / f"{scene.slug}.json"]


def score_clip_baselines(plan: ClipsPlan, scene: RealClip) -> None:
    """Score what needs no scene: pictures; masks where held-out frames have label maps; tracks where points are marked."""
    clip = open_clip(scene.path)
    found, teacher, known = image_baselines(clip), default_teacher(clip), marked_points(clip)
    if held_out_labels(clip) and teacher != "none":
        found |= mask_baselines(clip, teacher, ClipFlow(clip), silent)
    if known is not None:
        found |= point_baselines(clip, known)
    if scene.maps is not None and clip.labelled_frames:
        found |= score_first_map(clip, read_held_out_maps(scene.maps, clip))
    for path in baseline_files(plan, scene):
        write_json(path, found)


def held_out_labels(clip: Clip) -> list[int]:
    """Held-out frames that have a label map, if training frames have some too; else it is the one that is trained on."""
    scored = sorted(set(clip.test_frames) & set(clip.labelled_frames))
    return scored if len(scored) < len(clip.labelled_frames) else []


def marked_points(clip: Clip) -> KnownPoints | None:
    """Points that people marked, where the clip's data set keeps some beside it."""
    place = points_beside(clip.path)
    return None if place is None else read_points(place, len(clip), clip.size)


def clip_facts(scene: Scene, clip: Clip, teacher: str) -> dict[str, Any]:
    """What a table says of a clip."""
    valid = float(np.mean([clip.valid(i).mean() for i in clip.test_frames]))
    return {"teacher": teacher, "clip_frames": len(clip), "clip_size": list(scene.clip_size), "valid_share": valid}
