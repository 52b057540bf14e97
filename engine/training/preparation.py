"""What a training has before its first step: cameras, frames, optical flow, the teacher's targets, and the model to start from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from degense.engine.clip import Clip
from degense.engine.data.poses import find_cameras, with_cameras
from degense.engine.errors import Cancelled, DegenseError
from degense.engine.events import Events, Stage, Step
from degense.engine.field import FieldConfig, SceneModel
from degense.engine.profile import part
from degense.engine.progress import Progress
from degense.engine.semantics import TextEncoder
from degense.engine.semantics.teachers import CostlyTeacher, Teacher, default_teacher, teacher_by_name, with_cached_targets
from degense.engine.store import Run
from degense.engine.training.config import TrainConfig
from degense.engine.training.flow.along_sight import motion_along_sight
from degense.engine.training.flow.inferred import inferred_pairs
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians, persistent_only
from degense.engine.training.semantic.targets import SemanticTargets


@dataclass(frozen=True)
class Inputs:
    """What a training learns from."""

    clip: Clip  # with cameras
    frames: TrainingFrames
    flow: FlowSupervision | None  # None for a single training frame, or where flow has no weight
    teacher_name: str
    teacher: Teacher | CostlyTeacher | None
    semantics: SemanticTargets | None  # what the teacher says, where there is one

    @property
    def semantic_provenance(self) -> str:
        """Where the run's semantics come from, for its user."""
        return semantic_provenance(self.teacher, self.semantics)


def begin_stage(stage: str, events: Events, stop: Callable[[], bool] | None = None) -> Progress:
    """Report that a stage begins; its progress, which raises Cancelled when `stop()` asks to leave."""
    events(Stage(stage))

    def tell(fraction: float, message: str) -> None:
        events(Step(stage, round(fraction, 4), message))
        if stop is not None and stop():
            raise Cancelled

    return tell


def prepare(
    clip: Clip,
    run: Run | None,
    config: TrainConfig,
    teacher: str | None,
    encoder: TextEncoder | None,
    device: torch.device,
    events: Events,
    stop: Callable[[], bool],
) -> Inputs:
    """Find the cameras, read the clip, ask the teacher, measure optical flow. Raises Cancelled when `stop()` asks to leave.

    Label maps are read only by a teacher, and to find cameras only where the teacher is "labels"; only those of the frames that it teaches.
    What a pixelwise teacher calls an instrument is left out of the flow, so it is asked first. Of held-out frames nothing is read.
    A run that is resumed lends its cameras, so that it does not find others.
    """
    name = teacher or default_teacher(clip)
    if clip.poses != "given":
        if run is None:
            with part("poses"):
                clip = find_cameras(clip, begin_stage("poses", events, stop), labelled=name == "labels")
        else:
            clip = with_cameras(clip, run.cameras, run.info.get("provenance", {}).get("poses", "as the run has them"))
    tell = begin_stage("load", events, stop)
    with part("load"):
        frames = TrainingFrames(clip, config.max_pixels, device)
    if encoder is not None and name == "none":
        raise DegenseError("an encoder gives a teacher's classes their vectors, and there is no teacher; choose one, or no encoder")
    chosen = None if name == "none" else teacher_by_name(name, clip, encoder)
    tell(0.5, "reading the clip")
    semantics = None
    if chosen is not None:
        tell = begin_stage("teacher", events, stop)
        with part("teacher"):
            chosen = with_cached_targets(chosen, tell)
            semantics = SemanticTargets(chosen, frames, tell, guided=config.guided, rarity=config.rarity, max_rank=config.max_rank)
    flow = None
    if config.flow > 0 and len(clip.train_frames) > 1:
        with part("flow"):
            flow = _flow_of(frames, semantics, config, begin_stage("flow", events, stop))
    return Inputs(clip, frames, flow, name, chosen, semantics)


def _flow_of(frames: TrainingFrames, semantics: SemanticTargets | None, config: TrainConfig, tell: Progress) -> FlowSupervision:
    """Optical flow of the training frames, completed where it is not seen; labels of a sparse teacher propagate along it."""
    tools = semantics.tools if semantics is not None else None
    kinds = {"constancy": config.flow_constancy, "precision": config.flow_precision, "depth_precision": config.depth_precision}
    with part("measure"):
        flow = FlowSupervision(frames, lambda f, text: tell(0.7 * f, text), tools, **kinds)
    if config.flow_inference:
        with part("infer"):
            flow.completed = inferred_pairs(flow, lambda f, text: tell(0.7 + 0.2 * f, text))
    if config.depth_together:
        with part("motion along the line of sight"):
            flow.along_sight = motion_along_sight(flow)
    if semantics is not None:
        with part("propagate labels"):
            semantics.propagate(flow, lambda f, text: tell(0.9 + 0.1 * f, text))
    return flow


def build_model(inputs: Inputs, config: TrainConfig) -> SceneModel:
    """The model to start from, on the device of the frames."""
    rank = inputs.semantics.basis.rank if inputs.semantics is not None else 0
    field = field_config(config, len(inputs.clip), rank)
    random, start = np.random.default_rng(config.seed), int(config.max_gaussians * 0.7)
    canonical, bounds = initial_gaussians(inputs.frames, inputs.flow, start, rank, random, field.color_knots)
    if not config.velocities:
        canonical["velocities"].zero_()
    if config.persistent:
        canonical = persistent_only(canonical)
    return SceneModel(field, bounds, canonical).to(inputs.frames.device)


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
        config.linear_states,
    )


def semantic_provenance(teacher: Teacher | CostlyTeacher | None, semantics: SemanticTargets | None) -> str:
    """Where semantics come from: the teacher, and the frames its labels were propagated to."""
    if teacher is None or semantics is None:
        return "no semantics"
    others = len(semantics.frames) - len(semantics.labelled_frames)
    return teacher.provenance + (f"; propagated along the optical flow to {others} other frames" if others else "")
