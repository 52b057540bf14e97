"""What a process of a sweep does: it stays for many trainings, so that it imports and compiles once."""

from __future__ import annotations

import gc
import json
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from degense.engine.processes.parent import end_with_parent
from degense.engine.research.sweep.plan import SweepJob, SweepPlan
from degense.engine.research.sweep.schedule import Schedule

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene
    from degense.engine.training.config import TrainConfig

SCORED = ("masks", "motion", "inspection")


def begin_process(threads: int, flow: Path) -> None:
    """What holds for this process: how many threads it has, and where it shares optical flow."""
    import cv2
    import torch

    from degense.engine.research.sweep.clips import share_flow

    end_with_parent()
    cv2.setNumThreads(threads)
    torch.set_num_threads(threads)
    share_flow(flow)


def score_job(plan: SweepPlan, job: SweepJob) -> dict[str, Any]:
    """Train one job and score it."""
    from degense.engine.data.readers import open_clip
    from degense.engine.metrics.evaluate import evaluate

    folder, started = plan.clip(job.scene, job.depth), time.perf_counter()
    clip = open_clip(folder)
    with trained(clip, plan.out / "runs" / job.name, plan.config(job.method, job.seed), job.seeded_teacher) as scene:
        begun = time.perf_counter()
        scores = evaluate(scene, clip, parts=SCORED)
        scores["psnr_ceiling"] = json.loads((folder / "surgery.json").read_text(encoding="utf-8"))["psnr_ceiling"]
        return scores | {"job_seconds": time.perf_counter() - started, "score_seconds": time.perf_counter() - begun}


def warm_up(plan: Schedule) -> None:
    """Compile what compiles itself when it is first used, on a small phantom: other processes find it on disk."""
    from degense.engine.data.readers import open_clip
    from degense.engine.data.synthetic import PhantomOptions, make_phantom
    from degense.engine.metrics.evaluate import evaluate

    folder = plan.out / "warm"
    shutil.rmtree(folder, ignore_errors=True)
    make_phantom(folder / "clip", PhantomOptions(4, 64, 48))
    clip, small = open_clip(folder / "clip"), replace(plan, settings={"iterations": 60, "max_gaussians": 500, "semantic_steps": 10})
    with trained(clip, folder / "run", small.config(plan.methods[0], 0), "labels") as scene:
        evaluate(scene, clip, parts=SCORED)
    shutil.rmtree(folder)


@contextmanager
def trained(clip: Clip, run_folder: Path, config: TrainConfig, teacher: str) -> Iterator[Scene]:
    """A scene that is trained on a clip; its run is not kept."""
    import torch

    from degense.engine.scene import Scene
    from degense.engine.training import train

    shutil.rmtree(run_folder, ignore_errors=True)
    try:
        train(clip, run_folder, config, teacher=teacher, events=lambda event: None, stop=lambda: False)
        yield Scene.open(run_folder, device=config.device, clip=clip)
    finally:
        shutil.rmtree(run_folder, ignore_errors=True)
        gc.collect()
        if torch.cuda.is_available():
            torch.cuda.empty_cache()
