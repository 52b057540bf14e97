"""The training loop: coarse, then joint; guarded, cancellable, resumable."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from engine.field import SceneModel
from engine.progress import Progress
from engine.raster import Render, camera_depths, rasterize
from engine.splats import Splats
from engine.training.config import TrainConfig
from engine.training.density import Density
from engine.training.evidence import MotionEvidence, surface_visibility
from engine.training.frames import TrainingFrames
from engine.training.losses import inverse_depth, photometric, rigidity
from engine.training.neighbours import nearest_neighbours
from engine.training.optimiser import make_optimiser, set_rates
from engine.training.semantics import SemanticTargets

GUARD_EVERY = 100  # steps between looks at whether all is finite
NEIGHBOURS = 6
ROLLBACKS = 5


class Diverged(Exception):
    """Training left the numbers, repeatedly."""


class Trainer:
    """One training in memory.

    Parameters
    ----------
    model : SceneModel
    frames : TrainingFrames
    semantics : SemanticTargets or None
    evidence : MotionEvidence or None
    config : TrainConfig
    event : callable
        Told of rollbacks and progress, as plain dictionaries.
    """

    def __init__(
        self,
        model: SceneModel,
        frames: TrainingFrames,
        semantics: SemanticTargets | None,
        evidence: MotionEvidence | None,
        config: TrainConfig,
        event: Callable[[dict[str, Any]], None],
    ):
        self.model, self.frames, self.semantics, self.evidence, self.config, self.event = model, frames, semantics, evidence, config, event
        self.device = model.bounds.device
        self.optimizer = make_optimiser(model, config)
        self.density = Density(model, config.max_gaussians)
        self.random = np.random.default_rng(config.seed)
        self.generator = torch.Generator().manual_seed(config.seed)
        self.iteration = 0
        self.order: list[int] = []
        self.unseen = set(frames.clip.train_frames)  # since the last pruning
        self.caution = 1.0  # every rollback halves all learning rates
        self.rollbacks = 0
        self.running = torch.zeros(2, device=self.device)  # sums of loss and squared error since the last report
        self._neighbours: tuple[Tensor, Tensor] | None = None
        self.good = self.state()

    # -- state -----------------------------------------------------------------------------------------------------------------------------
    def state(self) -> dict[str, Any]:
        """Everything a later step depends on, copied."""
        copied = {name: value.detach().clone() for name, value in self.model.state_dict().items()}
        moments: dict[str, Tensor] = {}
        for name, parameter in self.model.named_parameters():
            if held := self.optimizer.state.get(parameter):
                moments |= {f"{name}.{key}": torch.as_tensor(held[key]).detach().clone() for key in ("step", "exp_avg", "exp_avg_sq")}
        evidence = {name: getattr(self.density, name).clone() for name in ("gradient", "seen", "opacity", "radius")}
        neighbours = dict(zip(("index", "weight"), self._neighbours, strict=True)) if self._neighbours is not None else {}
        plain = {
            "iteration": self.iteration,
            "order": list(self.order),
            "unseen": sorted(self.unseen),
            "caution": self.caution,
            "random": self.random.bit_generator.state,
            "rollbacks": self.rollbacks,
        }
        return {
            "model": copied,
            "moments": moments,
            "density": evidence,
            "neighbours": neighbours,
            "generator": self.generator.get_state(),
            "plain": plain,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go back to what `state()` returned."""
        for name in self.model.canonical:
            self.model.canonical[name] = torch.nn.Parameter(state["model"][f"canonical.{name}"].to(self.device).clone())
        self.model.load_state_dict(state["model"])
        self.optimizer = make_optimiser(self.model, self.config)
        for name, parameter in self.model.named_parameters():
            if f"{name}.exp_avg" in state["moments"]:
                self.optimizer.state[parameter] = {
                    key: state["moments"][f"{name}.{key}"].to(self.device).clone() for key in ("step", "exp_avg", "exp_avg_sq")
                }
        for name, value in state["density"].items():
            setattr(self.density, name, value.to(self.device).clone())
        self.generator.set_state(state["generator"])
        plain = state["plain"]
        self.iteration, self.order, self.caution, self.rollbacks = (
            plain["iteration"],
            list(plain["order"]),
            plain["caution"],
            plain["rollbacks"],
        )
        self.unseen = set(plain["unseen"])
        self.random.bit_generator.state = plain["random"]
        held = state["neighbours"]
        self._neighbours = (held["index"].to(self.device), held["weight"].to(self.device)) if held else None

    # -- one step --------------------------------------------------------------------------------------------------------------------------
    def step(self) -> None:
        """One frame, one update."""
        config, semantic_step = self.config, self._semantic_step()
        frame_index = self._next_frame(semantic_step)
        set_rates(self.optimizer, config, self.iteration, self.caution)
        deform = self.iteration >= config.coarse_iterations
        frame, camera = self.frames[frame_index], self.frames.cameras[frame_index]
        state = self.model.at(self.frames.clip.time(frame_index), deform=deform, semantics=False)
        splats = state.splats
        offsets = torch.zeros(len(splats), 2, device=self.device, requires_grad=True)
        render = draw(splats, camera, offsets)
        depth = render.image[..., 3]
        loss = photometric(render.image[..., :3], frame.image, frame.valid, config.ssim)
        if self.frames.clip.depth_measured and config.depth > 0:
            loss = loss + config.depth * inverse_depth(depth, render.alpha, frame.depth, frame.valid)
        if state.deformation is not None:
            loss = loss + self._field_losses(state)
            if self.evidence is not None and config.flow > 0:
                weight = config.flow * config.flow_final ** (self.iteration / config.iterations)
                loss = loss + weight * self._flow_loss(splats, render, frame_index)
        if semantic_step:
            loss = loss + config.semantic * self._semantic_loss(frame_index, deform)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self.optimizer.step()
        with torch.no_grad():
            error = ((render.image[..., :3] - frame.image).square() * frame.valid[..., None]).sum() / (3 * frame.valid.sum().clamp_min(1))
            self.running += torch.stack([loss.detach(), error])
            if offsets.grad is not None:
                self.density.observe(offsets.grad, render.radii, splats.opacities, camera.width / 2)
                self.unseen.discard(frame_index)
        self.iteration += 1
        self._edit()
        self._guard()

    def _semantic_step(self) -> bool:
        return self.semantics is not None and self.iteration % self.config.semantic_every == 0

    def _next_frame(self, semantic_step: bool) -> int:
        """Training frames in a new random order each round; on a semantic step, the next one of them that has a teacher's word, if any."""
        if not self.order:
            self.order = [self.frames.clip.train_frames[i] for i in self.random.permutation(len(self.frames.clip.train_frames))]
        if semantic_step and self.semantics is not None:
            spoken = set(self.semantics.frames)
            for position in range(len(self.order) - 1, -1, -1):
                if self.order[position] in spoken:
                    return self.order.pop(position)
        return self.order.pop()

    def _field_losses(self, state: Any) -> Tensor:
        config, deformation = self.config, state.deformation
        space, curvature, stillness = self.model.planes.smoothness()
        loss = config.plane_space * space + config.plane_time * curvature + config.plane_still * stillness
        loss = loss + config.displacement * (deformation.means.square().sum(1) + 1e-8).sqrt().mean()
        shape = deformation.log_scales.abs().mean() + deformation.quats.abs().mean() + deformation.opacities.abs().mean()
        loss = loss + config.shape * shape
        if state.recolour is not None:
            loss = loss + config.recolour * state.recolour.abs().mean()
        if config.rigidity > 0:
            if self._neighbours is None:
                self._neighbours = nearest_neighbours(self.model.canonical["means"].detach(), NEIGHBOURS)
            loss = loss + config.rigidity * rigidity(deformation.means, *self._neighbours)
        return loss

    def _flow_loss(self, splats: Splats, render: Render, frame: int) -> Tensor:
        assert self.evidence is not None
        pairs = self.evidence.pairs[frame]
        if not pairs:
            return splats.means.new_zeros(())
        pair = pairs[int(self.random.integers(len(pairs)))]
        there = self.model.means_at(self.frames.clip.time(pair.to))
        camera = self.frames.cameras[frame]
        visible = surface_visibility(splats.means, splats.opacities, render.radii, render.image[..., 3], render.alpha, camera)
        return self.evidence.loss(splats.means, there, visible, frame, pair)

    def _semantic_loss(self, frame_index: int, deform: bool) -> Tensor:
        """The semantic pass. `isolated` blends with detached geometry, so that no gradient of it can reach a shape or a place."""
        assert self.semantics is not None
        spoken = self.semantics.frames
        frame = frame_index if frame_index in set(spoken) else spoken[int(self.random.integers(len(spoken)))]
        state = self.model.at(self.frames.clip.time(frame), deform=deform)
        latent = draw_latents(state.splats, self.frames.cameras[frame], detached=self.config.routing == "isolated")
        loss = self.semantics.loss(latent, frame, use_angles=self.config.angular, region_weight=self.config.region)
        if state.resemantics is not None:
            loss = loss + self.config.resemantics * state.resemantics.abs().mean()
        return loss

    # -- between steps ---------------------------------------------------------------------------------------------------------------------
    def _edit(self) -> None:
        config = self.config
        if self.iteration % config.densify_every or self.iteration < config.densify_every:
            return
        if self.iteration <= config.densify_until * config.iterations:
            prune = not self.unseen
            self.density.step(self.optimizer, self.generator, prune=prune)
            if prune:
                self.unseen = set(self.frames.clip.train_frames)
            self._neighbours = None

    def _guard(self) -> None:
        """Every `GUARD_EVERY` steps: keep a copy of a finite state, or go back to the last one with half the learning rates."""
        if self.iteration % GUARD_EVERY:
            return
        healthy = torch.isfinite(self.running).all() & torch.stack([torch.isfinite(p).all() for p in self.model.parameters()]).all()
        if bool(healthy):
            self.good = self.state()
            return
        if self.rollbacks >= ROLLBACKS:
            raise Diverged(f"training diverged {ROLLBACKS + 1} times; the last good state is at step {self.good['plain']['iteration']}")
        failed = self.iteration
        rollbacks, caution = self.rollbacks + 1, self.caution / 2
        self.restore(self.good)
        self.rollbacks, self.caution = rollbacks, caution
        self.running.zero_()
        self.event(
            {
                "event": "rollback",
                "iteration": self.iteration,
                "reason": f"values stopped being numbers at step {failed}; learning rates halved",
            }
        )

    def report(self, steps: int) -> dict[str, float]:
        """Mean loss and PSNR (training frames, valid pixels) over the last `steps` steps; forgets them."""
        loss, error = (self.running / max(steps, 1)).tolist()
        self.running.zero_()
        return {"loss": loss, "psnr": float(-10 * np.log10(max(error, 1e-12))), "gaussians": len(self.model)}


def draw(splats: Splats, camera: Any, offsets: Tensor | None = None) -> Render:
    """Colour and z in one pass: image [H, W, 4]."""
    features = torch.cat([splats.colors, camera_depths(splats.means, camera)[:, None]], 1)
    return rasterize(splats.means, splats.quats, splats.scales, splats.opacities, features, camera, screen_offsets=offsets)


def draw_latents(splats: Splats, camera: Any, *, detached: bool) -> Tensor:
    """Latent map [H, W, d]; with `detached` geometry nothing but the latents receives a gradient."""
    place = splats.detach() if detached else splats
    return rasterize(place.means, place.quats, place.scales, place.opacities, splats.semantics, camera).image


def run_steps(trainer: Trainer, stop: Callable[[], bool], every: int, progress: Progress, after: Callable[[dict[str, Any]], None]) -> bool:
    """Train to the end, or until `stop()`; call `after(report)` every `every` steps. True when it reached the end."""
    last, started, first = trainer.iteration, time.perf_counter(), trainer.iteration
    total = trainer.config.iterations
    while trainer.iteration < total:
        if stop():
            return False
        trainer.step()
        if trainer.iteration - last >= every or trainer.iteration == total:
            seconds = time.perf_counter() - started
            eta = seconds / max(1, trainer.iteration - first) * (total - trainer.iteration)
            values = trainer.report(trainer.iteration - last)
            last = trainer.iteration
            after({"iteration": last, "iterations": total, **values, "seconds": seconds, "eta": eta})
            progress(last / total, "training")
    return True
