"""What a process of a sweep does: it stays for many trainings, so that it imports and compiles once."""

from __future__ import annotations

import gc
import json
import shutil
import time
from pathlib import Path
from typing import Any

from degense.engine.processes.parent import end_with_parent
from degense.engine.research.sweep.plan import SweepJob, SweepPlan


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
    """Train one job and score it; its run is not kept."""
    return _score(plan, job, plan.clip(job.scene, job.depth), plan.out / "runs" / job.name)


def warm_up(plan: SweepPlan) -> None:
    """Compile what compiles itself when it is first used, on a small phantom: other processes find it on disk."""
    from dataclasses import replace

    from degense.engine.data.synthetic import PhantomOptions, make_phantom

    folder = plan.out / "warm"
    shutil.rmtree(folder, ignore_errors=True)
    make_phantom(folder / "clip", PhantomOptions(4, 64, 48))
    small = replace(plan, settings={"iterations": 60, "max_gaussians": 500, "semantic_steps": 10})
    _score(small, SweepJob(0, "exact", "labels", plan.methods[0], 0), folder / "clip", folder / "run")
    shutil.rmtree(folder)


def _score(plan: SweepPlan, job: SweepJob, folder: Path, run_folder: Path) -> dict[str, Any]:
    import torch

    from degense.engine.data.readers import open_clip
    from degense.engine.metrics.evaluate import evaluate
    from degense.engine.scene import Scene
    from degense.engine.training import train

    started = time.perf_counter()
    shutil.rmtree(run_folder, ignore_errors=True)
    clip, config = open_clip(folder), plan.config(job.method, job.seed)
    try:
        train(clip, run_folder, config, teacher=job.seeded_teacher, events=lambda event: None, stop=lambda: False)
        trained = time.perf_counter()
        scene = Scene.open(run_folder, device=config.device, clip=clip)
        scores = evaluate(scene, clip, parts=("masks", "motion"))
        scores["psnr_ceiling"] = json.loads((folder / "surgery.json").read_text(encoding="utf-8"))["psnr_ceiling"]
        return scores | {"job_seconds": time.perf_counter() - started, "score_seconds": time.perf_counter() - trained}
    finally:
        shutil.rmtree(run_folder, ignore_errors=True)
        gc.collect()
        if torch.cuda.is_available():
            torch.cuda.empty_cache()
