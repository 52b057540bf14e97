"""From a clip to a run folder: find the cameras, load, ask the teacher, measure flow, train, save."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch

from degense.engine.clip import Clip
from degense.engine.data.poses import find_cameras, with_cameras
from degense.engine.data.readers import fingerprint
from degense.engine.errors import Cancelled, DegenseError
from degense.engine.events import Budget, Done, Events, Preview, Stage, Step, Stopped, TrainingProgress
from degense.engine.field import FieldConfig, SceneModel
from degense.engine.field.static_gaussians import find_moving
from degense.engine.files import replacing
from degense.engine.progress import Progress
from degense.engine.semantics import TextEncoder, open_encoder, save_encoder
from degense.engine.semantics.teachers import CostlyTeacher, Teacher, default_teacher, teacher_by_name, with_cached_targets
from degense.engine.store import Run
from degense.engine.store.migrations import current_settings
from degense.engine.store.run import hardware
from degense.engine.training.checkpoint import load_checkpoint, save_checkpoint
from degense.engine.training.config import TrainConfig, choose_device
from degense.engine.training.fitting.budget import fit_budget
from degense.engine.training.fitting.estimate import estimate
from degense.engine.training.flow.observability import motion_observability
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians, persistent_only
from degense.engine.training.semantic.codebook import fit_codebook
from degense.engine.training.semantic.distillation import fit_meaning
from degense.engine.training.semantic.targets import SemanticTargets
from degense.engine.training.trainer import Diverged, Trainer, draw, run_steps

REPORT_EVERY = 25
PREVIEW_SECONDS = 5.0
STILL_MOMENTS = 64  # at most, at which Gaussians are looked at for motion
STILL_SHARE = 0.05  # still Gaussians that must be found before leaving them out is worth the bookkeeping


def train(
    clip: Clip,
    out: Path,
    config: TrainConfig,
    *,
    teacher: str | None = None,
    encoder: TextEncoder | None = None,
    resume: bool = False,
    events: Events,
    stop: Callable[[], bool],
) -> Run | None:
    """Train a scene of `clip` into the run folder `out`.

    Returns the finished run, or None when `stop()` asked to leave; the run can then be resumed.

    Cameras that the clip does not bring are found first (`engine.data.poses`); the run keeps them.

    Parameters
    ----------
    teacher : str or None
        A name that `engine.semantics.teacher_by_name` knows, "none", or None for the clip's default.
    encoder : TextEncoder or None
        Whose text vectors a teacher by label maps or strokes gives the classes; None for the embedded one's.
    resume : bool
        Continue the training in `out` with the settings it started with.
    """
    device = choose_device(config.device)
    torch.manual_seed(config.seed)
    started = time.perf_counter()

    def progress(stage: str) -> Progress:
        events(Stage(stage))

        def tell(fraction: float, message: str) -> None:
            events(Step(stage, round(fraction, 4), message))
            if stop():
                raise Cancelled

        return tell

    run = Run.open(out) if resume else None
    checkpoint = None
    if run is not None:
        config = TrainConfig.from_json(current_settings(run.info["config"]) | {"device": config.device})
        teacher = run.info["teacher"]["name"]
        if teacher != "none" and teacher.partition(":")[0] not in ("precomputed", "vlm"):
            encoder = open_encoder(run.info["encoder"], run.info["classes"], out, encoder)
        if run.info["clip"]["fingerprint"] != fingerprint(clip):
            raise DegenseError(f"{clip.path} is not the clip that {out} was trained on; resume with that clip or start a new run")
        if run.info["state"] == "finished":
            raise DegenseError(f"{out} has finished its {config.iterations} iterations; start a new run to train longer")
        if (out / "checkpoints" / "last.json").exists():
            checkpoint = load_checkpoint(out / "checkpoints")
    elif (out / "run.json").exists():
        raise DegenseError(f"{out} already holds a run; choose another folder or add --resume")

    try:
        if clip.poses != "given":
            clip = find_cameras(clip, progress("poses")) if run is None else _cameras_of(run, clip)
        tell = progress("load")
        teacher = teacher or default_teacher(clip)
        frames = TrainingFrames(clip, config.max_pixels, device)
        if encoder is not None and teacher == "none":
            raise DegenseError("an encoder gives a teacher's classes their vectors, and there is no teacher; choose one, or no encoder")
        chosen = None if teacher == "none" else teacher_by_name(teacher, clip, encoder)
        tell(0.5, "reading the clip")
        evidence = FlowSupervision(frames, progress("flow")) if config.flow > 0 and len(clip.train_frames) > 1 else None
        semantics = None
        if chosen is not None:
            tell = progress("teacher")
            chosen = with_cached_targets(chosen, tell)
            semantics = SemanticTargets(chosen, frames, evidence, tell, guided=config.guided, max_rank=config.max_rank)
    except Cancelled:
        return None

    chosen_budget = None
    if run is None and config.fit:
        budget = fit_budget(frames, config, evidence, semantics.basis if semantics is not None else None)
        config, chosen_budget = budget.config, budget.to_json()
        events(Budget([*budget.words, estimate(clip, replace(config, fit=False))["words"]]))
    field = field_config(config, len(clip), semantics.basis.rank if semantics is not None else 0)
    random = np.random.default_rng(config.seed)
    canonical, bounds = initial_gaussians(frames, evidence, int(config.max_gaussians * 0.7), field.rank, random, field.color_knots)
    if not config.velocities:
        canonical["velocities"].zero_()
    if config.persistent:
        canonical = persistent_only(canonical)
    model = SceneModel(field, bounds, canonical).to(device)
    if run is None:
        info = {
            "clip": {"path": portable(clip.path, out), "name": clip.name, "fingerprint": fingerprint(clip), "options": clip.options},
            "config": config.to_json(),
            "field": field.to_json(),
            "unit": frames.unit,
            "reference_frame": clip.train_frames[0],
            "train_frames": clip.train_frames,
            "test_frames": clip.test_frames,
            "teacher": {"name": teacher, "provenance": semantic_provenance(chosen, semantics)},
            "encoder": chosen.encoder.name if chosen is not None else None,
            "train_seconds": 0.0,
            "budget": chosen_budget,
        }
        run = Run.create(out, clip, info)
        if chosen is not None and semantics is not None:
            run.save_basis(semantics.basis)
            save_encoder(chosen.encoder, out)
    afterwards = semantics if config.routing == "isolated" else None  # there, no semantic gradient reaches geometry: it need not wait
    trainer = Trainer(model, frames, None if afterwards is not None else semantics, evidence, config, events)
    if checkpoint is not None:
        trainer.restore(checkpoint)
    run.info |= {"state": "training", "hardware": hardware()}
    run.save()
    return _loop(run, trainer, afterwards, events, stop, started)


def field_config(config: TrainConfig, frames: int, rank: int) -> FieldConfig:
    """The field for a clip of so many frames."""
    return FieldConfig(
        config.routing,
        rank,
        config.appearance,
        max(2, math.ceil(frames / config.color_spacing)) if config.appearance else 0,
        config.channels,
        config.resolution,
        config.time_resolution or max(2, (frames + 1) // 2),
        config.levels,
        config.static,
        config.fixed_latents,
    )


def _cameras_of(run: Run, clip: Clip) -> Clip:
    """The clip with the cameras that a run began with: a resumed training must not find others."""
    return with_cameras(clip, run.cameras, run.info.get("provenance", {}).get("poses", "as the run has them"))


def semantic_provenance(teacher: Teacher | CostlyTeacher | None, semantics: SemanticTargets | None) -> str:
    """Where the run's meaning comes from, for its user."""
    if teacher is None or semantics is None:
        return "no semantics"
    carried = len(semantics.frames) - len(semantics.spoken)
    return teacher.provenance + (f"; carried along the optical flow to {carried} other frames" if carried else "")


def _loop(
    run: Run, trainer: Trainer, afterwards: SemanticTargets | None, events: Events, stop: Callable[[], bool], started: float
) -> Run | None:
    spent = float(run.info["train_seconds"])
    config = trainer.config
    last_checkpoint = last_preview = time.perf_counter()
    stage = ""

    def after(values: TrainingProgress) -> None:
        nonlocal last_checkpoint, last_preview, stage
        current = "coarse" if values.iteration <= config.coarse_iterations else "joint"
        if current != stage:
            stage = current
            events(Stage(stage))
        run.log(asdict(values))
        events(values)
        now = time.perf_counter()
        if now - last_preview > PREVIEW_SECONDS or values.iteration == trainer.total:
            events(write_preview(run, trainer))
            last_preview = now
        if now - last_checkpoint > config.checkpoint_seconds:
            save_checkpoint(run.path / "checkpoints", trainer.state())
            last_checkpoint = time.perf_counter()

    try:
        finished = run_steps(trainer, stop, REPORT_EVERY, after)
    except Diverged as error:
        trainer.restore(trainer.good)
        save_checkpoint(run.path / "checkpoints", trainer.state())
        run.info |= {"state": "diverged"}
        run.save()
        raise DegenseError(f"{error}; {run.path} keeps it. Try a smaller preset or check the clip's depth and masks") from error
    if finished and afterwards is not None:
        events(Stage("meaning"))

        def tell(fraction: float, message: str) -> None:
            events(Step("meaning", round(fraction, 4), message))

        fit = fit_codebook if config.codebook else fit_meaning
        finished = fit(trainer.model, afterwards, trainer.frames, config, stop, tell)
    if trainer.device.type == "cuda":
        torch.cuda.synchronize()
    run.info |= {"train_seconds": spent + time.perf_counter() - started, "iteration": trainer.iteration, "gaussians": len(trainer.model)}
    if not finished:
        save_checkpoint(run.path / "checkpoints", trainer.state())
        run.info["state"] = "stopped"
        run.save()
        events(Stopped(trainer.iteration))
        return None
    still = keep_still_out(trainer)
    if run.info.get("budget") is not None:
        record = {"static Gaussians": still, **({"early stopping": trainer.early.to_json()} if config.early_stopping else {})}
        run.info["budget"]["chosen"] |= record
    run.save_model(trainer.model)
    if trainer.evidence is not None:
        run.save_observability(motion_observability(trainer.model, trainer.frames, trainer.evidence))
    run.info["state"] = "finished"
    run.save()
    for file in (run.path / "checkpoints").iterdir():
        file.unlink()
    events(Done(str(run.path)))
    return run


def keep_still_out(trainer: Trainer) -> dict[str, Any]:
    """Let Gaussians that the field never changes visibly stay out of it for good; the record of it, as `Choice` has them."""
    model, clip = trainer.model, trainer.frames.clip
    watched = np.linspace(0, len(clip) - 1, min(len(clip), STILL_MOMENTS))
    moving = find_moving(model, [clip.time(i) for i in watched], trainer.frames.cameras[0].fx)
    left = len(model) - len(moving)
    if left >= STILL_SHARE * len(model):
        model.set_moving(moving)
    why = f"the field changes {len(moving):,} of {len(model):,} visibly"
    return {"preset": len(model), "chosen": len(model) if model.moving is None else len(moving), "why": why}


@torch.no_grad()
def write_preview(run: Run, trainer: Trainer) -> Preview:
    """Draw the first held-out frame (or the first frame) as `previews/last.png`."""
    clip = trainer.frames.clip
    frame = (clip.test_frames or [0])[0]
    deform = trainer.iteration >= trainer.config.coarse_iterations
    image = draw(trainer.model.at(clip.time(frame), deform=deform, semantics=False).splats, trainer.frames.cameras[frame]).image[..., :3]
    picture = (image.clamp(0, 1) * 255).byte().cpu().numpy()
    path = run.path / "previews" / "last.png"
    with replacing(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", picture[..., ::-1])[1].tobytes())
    return Preview(str(path), frame)


def portable(path: Path, start: Path) -> str:
    """`path` relative to the run when they share a folder, so that both can be moved together; else absolute."""
    path, start = path.resolve(), start.resolve()
    return os.path.relpath(path, start) if path.is_relative_to(start.parent) else str(path)
