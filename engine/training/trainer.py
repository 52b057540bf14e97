"""The training loop's step: coarse, then joint; guarded against divergence, exactly resumable."""

from __future__ import annotations

from functools import reduce
from operator import add
from typing import Any

import numpy as np
import torch
from torch import Tensor

from degense.engine.events import Events, Rollback
from degense.engine.field import SceneModel
from degense.engine.profile import is_recorded, part, renamed_at_gradient
from degense.engine.raster import rasterize
from degense.engine.raster.camera_tensors import view_and_lens
from degense.engine.splats import Splats
from degense.engine.training.config import TrainConfig
from degense.engine.training.density import Density
from degense.engine.training.flow.supervision import FlowSupervision, Pair
from degense.engine.training.frames import FrameOrder, TrainingFrames
from degense.engine.training.loss_terms import Loss, LossSums
from degense.engine.training.losses import angular, l1
from degense.engine.training.optimiser import learned_state, make_optimiser, restore_learned, set_rates
from degense.engine.training.passes import SMOOTHNESS_EVERY, FieldState, Passes, draw_latents
from degense.engine.training.semantic.consensus import Consensus, agreed_answers, answers_of
from degense.engine.training.semantic.finished import FinishedGeometry
from degense.engine.training.semantic.targets import SemanticTargets
from degense.engine.training.step_graph import StepGraph

GUARD_EVERY = 100  # steps between tests of whether all is finite
ROLLBACKS = 5
FLOW_PARTS = 4  # on the CPU the flow asks one of so many parts of the Gaussians a step: motion is smooth, and half of a step's work is this


class Diverged(Exception):
    """Training left the numbers, repeatedly."""


class Trainer:
    """One training in memory; `events` gets `Rollback`."""

    def __init__(
        self,
        model: SceneModel,
        frames: TrainingFrames,
        semantics: SemanticTargets | None,
        flow: FlowSupervision | None,
        config: TrainConfig,
        events: Events,
    ):
        self.model, self.frames, self.semantics, self.flow = model, frames, semantics, flow
        self.config, self.events = config, events
        self.device = model.bounds.device
        self.optimizer = make_optimiser(model, config)
        self.density = Density(model, config.max_gaussians)
        self.order = FrameOrder(frames.clip.train_frames, config.seed)
        self.generator = torch.Generator().manual_seed(config.seed)
        self.iteration = 0
        self.rate_scale = 1.0  # of all learning rates; every rollback halves it
        self.rollbacks = 0
        self.sums = LossSums(self.device)
        self.times = torch.tensor([frames.clip.time(i) for i in range(len(frames.clip))], device=self.device)
        self.unseen = set(frames.clip.train_frames)  # since the last pruning
        depth = config.depth * (1.0 if flow is None else flow.depth_precision) if frames.clip.depth_measured else 0.0
        whole = self.device.type == "cuda" and semantics is None and not is_recorded()  # a profile tells the parts of a step apart
        self.passes = Passes(model, config, depth=depth, semantics=semantics is not None, in_step_graph=whole)
        self._step_graph = StepGraph(model, self.passes, self.density, self.sums) if whole else None
        self._smoothness_weight = torch.full((), float(SMOOTHNESS_EVERY), device=self.device)
        self._told, self._consensus = semantics, dict[str, Tensor]()
        self.last_finite = self.state()

    # -- state -----------------------------------------------------------------------------------------------------------------------------
    def state(self) -> dict[str, Any]:
        """Everything a later step depends on, copied."""
        neighbours = self.passes.neighbours
        return {
            **learned_state(self.model, self.optimizer),
            "density": self.density.state(),
            "neighbours": dict(zip(("index", "weight"), neighbours, strict=True)) if neighbours is not None else {},
            "consensus": self._consensus,
            "generator": self.generator.get_state(),
            "plain": {
                "iteration": self.iteration,
                "unseen": sorted(self.unseen),
                "rate_scale": self.rate_scale,
                "rollbacks": self.rollbacks,
                **self.order.state(),
            },
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to what `state()` returned."""
        self.optimizer = restore_learned(self.model, self.config, state)
        self.density.restore(state["density"])
        self.generator.set_state(state["generator"])
        plain, neighbours = state["plain"], state["neighbours"]
        self.iteration, self.rate_scale, self.rollbacks = (plain[name] for name in ("iteration", "rate_scale", "rollbacks"))
        self.unseen = set(plain["unseen"])
        self.order.restore(plain["order"], plain["random"])
        self._agree(state["consensus"])
        self.passes.neighbours = tuple(neighbours[name].to(self.device) for name in ("index", "weight")) if neighbours else None
        self.passes.forget()

    @property
    def progress(self) -> float:
        """How far the training has got, 0 to 1: what the learning rates follow."""
        return self.iteration / self.config.iterations

    @property
    def deforms(self) -> bool:
        """False in the coarse stage, in which static Gaussians are drawn."""
        return self.iteration >= self.config.coarse_iterations

    @property
    def moves(self) -> bool:
        """Whether the field still learns."""
        return self.progress <= self.config.motion_share

    @property
    def _teaching(self) -> FlowSupervision | None:
        """The optical flow that teaches motion; None where colour alone does, and when motion is no longer learned."""
        return self.flow if self.config.flow > 0 and self.moves else None

    @property
    def densifies(self) -> bool:
        """Whether Gaussians are still cloned, split and pruned."""
        return self.progress < self.config.densify_until

    def _agree(self, consensus: dict[str, Tensor]) -> None:
        """Let semantics learn what a consensus says (`agreed_answers`), or the teacher where that is empty."""
        self._consensus, self.semantics = consensus, self._told
        if self._told is not None and consensus:
            self._told.disagreement, self._told.accuracy = (float(consensus[name]) for name in ("disagreement", "accuracy"))
            self.semantics = self._told.replaced(answers_of(consensus, self._told.labelled_frames))

    # -- one step --------------------------------------------------------------------------------------------------------------------------
    def step(self) -> None:
        """One frame, one update."""
        told = self._told
        if told is not None and self.config.consensus and not (told.sparse or self.densifies or self._consensus):
            self._agree(agreed_answers(Consensus(FinishedGeometry(self.model, self.frames), told, self.config.seed), told))
        semantic = self.semantics is not None and self.iteration % self.config.semantic_every == 0
        index = self._next_frame(semantic)
        set_rates(self.optimizer, self.config, self.progress, self.rate_scale)
        camera, pair = self.frames.cameras[index], self._pair(index)
        other = None if pair is None else self.times[pair.to]
        rows, present = self._rows(self.times[index])
        parts = (other, rows, present) if present is not None else () if other is None else (other,)
        asked = self.times[index], view_and_lens(camera, self.device), self._precision(index), *parts
        with part("prepare passes"):
            self._make_passes(asked)
        flow = () if self.flow is None or pair is None else self.flow.inputs(index, pair)
        if self._step_graph is not None:
            smoothness = self._smoothness_weight if self.passes.smooths(self.iteration) else None
            self._step_graph(camera, self.frames[index], asked, flow, smoothness, observe=self.densifies)
        else:
            self._step_in_parts(index, flow, asked, rows, semantic=semantic)
        with part("optimiser"):
            self.optimizer.step()
        with part("density"):
            if self.densifies:
                self.unseen.discard(index)
            stage = self.deforms, self.moves
            self.iteration += 1
            if (self.deforms, self.moves) != stage:
                self.passes.forget()
            self._densify()
        with part("guard"):
            self._guard()

    def _step_in_parts(
        self, index: int, flow: tuple[Tensor, ...], asked: tuple[Tensor | None, ...], rows: Tensor | None, *, semantic: bool
    ) -> None:
        """Gradients of a step, one part of it after the other, and what is noted of it."""
        camera = self.frames.cameras[index]
        with part("field"):
            field = FieldState(*self.passes("field", *asked))
        offsets = torch.zeros(len(field.means), 2, device=self.device, requires_grad=self.densifies)
        with part("raster"):
            render = rasterize(field.splats, field.features, camera, screen_offsets=offsets, clean=True)
        renamed_at_gradient(field.features, "field backward")
        renamed_at_gradient(render.image, "raster backward")
        with part("losses"):
            frame = self.frames[index]
            losses, squared_error = self.passes.losses(field, render, (frame.image, frame.valid, frame.depth), flow, rows)
            if self.passes.smooths(self.iteration):
                losses["smoothness"] = Loss(*self.passes("smoothness", self._smoothness_weight))
            if semantic:
                losses["semantic"] = self._semantic_loss(index)
            loss = reduce(add, (found.total for found in losses.values()))
        self.optimizer.zero_grad()
        with part("losses backward"):
            loss.backward()
        self.sums.add(loss, squared_error, losses)
        if offsets.grad is not None:
            with part("density"):
                self.density.observe(offsets.grad, render.radii, field.opacities, camera.width / 2)

    def _rows(self, t: Tensor) -> tuple[Tensor | None, Tensor | None]:
        """Which Gaussians the flow of this step asks, int64 [m], and which are deformed, int64 [k]: those that may be drawn at `t`.

        None for all: on a GPU, and where nothing is deformed.
        """
        if self.device.type != "cpu" or not self.deforms or self.config.static:
            return None, None
        present = self.model.present(t)
        return present[present % FLOW_PARTS == self.iteration % FLOW_PARTS], present

    def _make_passes(self, asked: tuple[Tensor | None, ...]) -> None:
        """Make what reads the model, when the Gaussians or the stage have changed: before any gradient of this step is on its way."""
        if not self.passes.ready:
            self.optimizer.zero_grad()
            self.optimizer.forget()  # gradients lie in the memory of the old CUDA graphs, which is given back now
            if self._step_graph is not None:
                self._step_graph.forget()
            self.passes.make(asked, self._smoothness_weight, deform=self.deforms, learn=self.moves)

    def _pair(self, frame: int) -> Pair | None:
        """One of the frames to which the flow of this one is known, at random; None where motion is not learned from flow, or no more."""
        pairs = self._teaching.pairs[frame] if self._teaching is not None else []
        return self.order.any_of(pairs) if pairs else None

    def _precision(self, frame: int) -> Tensor:
        """How well the texture of a frame pins motion down; empty where flow teaches no motion, or it is not asked for."""
        if self._teaching is None or not self.config.photometric_precision:
            return torch.zeros(0, device=self.device)
        return self._teaching.precision[frame]

    def _next_frame(self, semantic: bool) -> int:
        """All training frames at random, on a semantic step one with a target if any is left; in most coarse stages the first."""
        if not self.deforms and self.config.coarse_frames == "first":
            return self.frames.clip.train_frames[0]
        wanted = set(self.semantics.frames) if semantic and self.semantics is not None else ()
        return self.order.next(wanted)

    def _semantic_loss(self, frame_index: int) -> Loss:
        """The semantic pass, on this step's frame where it has a target, else on another."""
        assert self.semantics is not None
        config, labelled = self.config, self.semantics.frames
        frame = frame_index if frame_index in set(labelled) else self.order.any_of(labelled)
        means, quats, scales, opacities, latents, regularizer = self.passes("semantic", self.times[frame])
        splats = Splats(means, quats, scales, opacities, means.new_zeros(len(means), 3), latents)
        latent = draw_latents(splats, self.frames.cameras[frame], detached=config.routing == "isolated")
        terms = self.semantics.loss(latent, frame, angular if config.angular else l1, config.region)
        return Loss.of("semantic", {**terms, "delta_semantics": regularizer}, regularizer.new_zeros(())).times(config.semantic)

    # -- between steps ---------------------------------------------------------------------------------------------------------------------
    def _densify(self) -> None:
        """Clone, split and prune when it is time; the passes are made anew then."""
        config = self.config
        if self.iteration % config.densify_every or self.progress > config.densify_until:
            return
        prune = not self.unseen
        self.density.step(self.optimizer, self.generator, prune=prune)
        if prune:
            self.unseen = set(self.frames.clip.train_frames)
        self.passes.neighbours = None
        self.passes.forget()

    def _guard(self) -> None:
        """Every `GUARD_EVERY` steps: keep a copy of a finite state, or go back to the last one with half the learning rates.

        Where tiles had too little room meanwhile the steps are only taken again.
        """
        if self.iteration % GUARD_EVERY:
            return
        finite = bool(torch.stack([torch.isfinite(values).all() for values in (self.sums.totals, *self.model.parameters())]).all())
        short = self._step_graph is not None and self._step_graph.ran_out_of_room(finite=finite)
        if finite and not short:
            self.last_finite = self.state()
            return
        if not finite and self.rollbacks >= ROLLBACKS:
            good = self.last_finite["plain"]["iteration"]
            raise Diverged(f"training diverged {ROLLBACKS + 1} times; the last good state is at step {good}")
        failed, rollbacks, scale = self.iteration, self.rollbacks + 1, self.rate_scale / 2
        self.restore(self.last_finite)
        self.sums.zero_()
        if not finite:
            self.rollbacks, self.rate_scale = rollbacks, scale
            self.events(Rollback(self.iteration, f"values stopped being numbers at step {failed}; learning rates halved"))

    def report(self, steps: int) -> dict[str, Any]:
        """Mean loss, its terms, and PSNR (training frames, valid pixels) over the last `steps` steps; forgets them."""
        loss, error, terms = self.sums.means(steps)
        return {"loss": loss, "psnr": float(-10 * np.log10(max(error, 1e-12))), "gaussians": len(self.model), "losses": terms}
