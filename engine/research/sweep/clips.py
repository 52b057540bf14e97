"""What all trainings on a surgery share: its clip with each depth, its optical flow, and the baselines."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from degense.engine.data.files.images import read_rgb
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.data.synthetic.recording import Recorder
from degense.engine.files import replacing, write_text
from degense.engine.progress import silent
from degense.engine.research.baselines.ceiling import mask_ceiling
from degense.engine.research.baselines.clip_flow import ClipFlow
from degense.engine.research.baselines.images import image_baselines
from degense.engine.research.baselines.masks import mask_baselines
from degense.engine.research.baselines.motion import motion_baselines
from degense.engine.research.sweep.plan import Depth, SweepPlan, seeded, slug
from degense.engine.semantics.teachers.target_cache import digest
from degense.engine.store.files import write_json
from degense.engine.training.flow.supervision import FlowSupervision, MeasuredFlow, measure_flow
from degense.engine.training.frames import TrainingFrames

SHARED = ("images", "labels", "classes.json", "surgery.json", "camera.json", "gt.npz")


def prepare_scene(plan: SweepPlan, scene: int) -> None:
    """Draw the clips of a scene and measure the flow between their training frames, unless they are there."""
    width, height = plan.size
    exact = plan.clip(scene, "exact")
    if not exact.exists():
        make_phantom(exact, PhantomOptions(plan.frames, width, height, scene, kind="family"))
    for depth in plan.depths:
        if not plan.clip(scene, depth).exists():
            draft = plan.clip(scene, depth).with_suffix(".draft")
            shutil.rmtree(draft, ignore_errors=True)
            with_depth(exact, draft, depth, scene)
            draft.rename(plan.clip(scene, depth))
    if any(plan.config(method, 0).flow > 0 for method in plan.methods):
        clip = open_clip(exact)
        FlowSupervision(TrainingFrames(clip, plan.config(plan.methods[0], 0).max_pixels, torch.device("cpu")), constancy=False)


def with_depth(exact: Path, out: Path, depth: Depth, seed: int) -> None:
    """The clip of `exact` with another depth, as `degense phantom --depth` writes it.

    Without depth the scale is unknown, and a reader's prior has the median 1: cameras and truth are given in units of the true median depth
    of the first frame, so that only the depth is missing.
    """
    out.mkdir(parents=True)
    for name in SHARED:
        copy: Callable[..., Any] = shutil.copytree if (exact / name).is_dir() else shutil.copy2
        copy(exact / name, out / name, **({"copy_function": os.link} if (exact / name).is_dir() else {}))
    camera = json.loads((exact / "camera.json").read_text(encoding="utf-8"))
    if depth == "noisy":
        (out / "depth").mkdir()
        recorder = Recorder(seed, 0.0)
        for index, path in enumerate(sorted((exact / "depth").iterdir())):
            image = read_rgb(exact / "images" / f"{path.stem}.png")
            np.save(out / "depth" / path.name, recorder.stereo_depth(np.load(path), image, camera["fx"], index))
        return
    unit = float(np.median(np.load(exact / "depth" / "000000.npy")))
    for viewmat in camera["viewmats"]:
        for row in viewmat[:3]:
            row[3] /= unit
    write_text(out / "camera.json", json.dumps({name: value for name, value in camera.items() if name != "unit"}))
    with np.load(exact / "gt.npz") as truth, replacing(out / "gt.npz") as temporary:
        lengths = {name: truth[name] / np.float32(unit) for name in ("displacement", "tracks")}
        np.savez(temporary, **lengths, cautery=truth["cautery"], visible=truth["visible"])


def share_flow(folder: Path) -> None:
    """From now on, trainings of this process keep measured flow in `folder`, by the content of the frames, and read what is there."""

    def measure(frames: Sequence[np.ndarray]) -> Iterator[MeasuredFlow]:
        path = folder / f"{digest(*frames)}.npy"
        if not path.exists():
            found = [np.stack([*step, *far]) for step, far in measure_flow(frames)]
            with replacing(path) as temporary:
                np.save(temporary, np.stack(found))
        for one, two, three, four in np.load(path, mmap_mode="r"):
            yield (np.array(one), np.array(two)), (np.array(three), np.array(four))

    FlowSupervision.measure = staticmethod(measure)


def baseline_files(plan: SweepPlan, scene: int) -> dict[Path, tuple[Depth, str | None]]:
    """Where the baselines of a scene are kept: of pictures and motion for each depth, of masks for each teacher and seed."""
    folder = plan.out / "baselines"
    motion: dict[Path, tuple[Depth, str | None]] = {folder / f"{scene:03d}-{depth}.json": (depth, None) for depth in plan.depths}
    names = {seeded(teacher, seed) for teacher in plan.teachers for seed in plan.seeds if teacher != "none"}
    return motion | {folder / f"{scene:03d}-{slug(name)}.json": (plan.depths[0], name) for name in sorted(names)}


def score_scene_baselines(plan: SweepPlan, scene: int) -> None:
    """Score the baselines of a scene that are not kept yet, and the ceiling of masks; one flow serves all: pictures have no depth."""
    missing = {path: what for path, what in baseline_files(plan, scene).items() if not path.exists()}
    flow: ClipFlow | None = None
    ceiling: dict[str, Any] | None = None  # of the exact depth, whichever one is scored
    for path, (depth, teacher) in missing.items():
        clip = open_clip(plan.clip(scene, depth))
        flow = flow or ClipFlow(clip)
        if teacher is None:
            ceiling = mask_ceiling(open_clip(plan.clip(scene, "exact"))) if ceiling is None else ceiling
            found = image_baselines(clip) | motion_baselines(clip, flow) | ceiling
        else:
            found = mask_baselines(clip, teacher, flow, silent)
        write_json(path, found)
