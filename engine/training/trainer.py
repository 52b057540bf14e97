"""The training loop: coarse, then joint; guarded, cancellable, resumable."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.events import EarlyStopped, Events, Rollback, TrainingProgress
from degense.engine.field import SceneModel
from degense.engine.raster import Render, camera_depths, rasterize
from degense.engine.raster.camera_tensors import view_and_lens
from degense.engine.splats import Splats
from degense.engine.training.config import TrainConfig
from degense.engine.training.cuda_graphs import recorded
from degense.engine.training.density import Density
from degense.engine.training.fitting.early_stopping import EarlyStopping
from degense.engine.training.flow.supervision import FlowSupervision, Pair
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.neighbours import nearest_neighbours
from degense.engine.training.optimiser import make_optimiser, set_rates
from degense.engine.training.passes import CurvePass, FieldPass, PictureLoss, SemanticPass, motion_loss
from degense.engine.training.semantic.targets import SemanticTargets

GUARD_EVERY = 100  # steps between looks at whether all is finite
NEIGHBOURS = 6
ROLLBACKS = 5
WATCH_EVERY = 50  # steps between looks at the validation frames
CURVES_EVERY = 4  # steps between looks at the regularisers of planes and curves, which change slowly


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
    events : callable
        Gets `Rollback` and `EarlyStopped`.
    """

    def __init__(
        self,
        model: SceneModel,
        frames: TrainingFrames,
        semantics: SemanticTargets | None,
        evidence: FlowSupervision | None,
        config: TrainConfig,
        events: Events,
    ):
        self.model, self.frames, self.semantics, self.evidence = model, frames, semantics, evidence
        self.config, self.events = config, events
        self.device = model.bounds.device
        self.optimizer = make_optimiser(model, config)
        self.density = Density(model, config.max_gaussians)
        self.random = np.random.default_rng(config.seed)
        self.generator = torch.Generator().manual_seed(config.seed)
        self.iteration = 0
        self.order: list[int] = []
        self.caution = 1.0  # every rollback halves all learning rates
        self.rollbacks = 0
        self.running = torch.zeros(2, device=self.device)  # sums of loss and squared error since the last report
        self.times = torch.tensor([frames.clip.time(i) for i in range(len(frames.clip))], device=self.device)
        self.early = EarlyStopping(config.iterations, frames.clip.train_frames if config.early_stopping else ())
        self.unseen = set(frames.clip.train_frames) - self._held  # since the last pruning
        self._neighbours: tuple[Tensor, Tensor] | None = None
        self._recordings: dict[str, Callable[..., Any]] = {}
        self._curves_every = torch.full((), float(CURVES_EVERY), device=self.device)
        self._picture_loss = PictureLoss(config, depth=frames.clip.depth_measured and config.depth > 0)
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
            "early": self.early.state(),
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
        for name, old in self.model.canonical.items():
            kept = state["model"][f"canonical.{name}"].to(self.device).clone()
            self.model.canonical[name] = torch.nn.Parameter(kept, old.requires_grad)
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
        self.early.restore(**plain["early"])
        self.random.bit_generator.state = plain["random"]
        held = state["neighbours"]
        self._neighbours = (held["index"].to(self.device), held["weight"].to(self.device)) if held else None
        self._forget_recordings()

    # -- one step --------------------------------------------------------------------------------------------------------------------------
    def step(self) -> None:
        """One frame, one update."""
        config, semantic_step = self.config, self._semantic_step()
        index = self._next_frame(semantic_step)
        set_rates(self.optimizer, config, self.progress, self.caution)
        frame, camera, pair = self.frames[index], self.frames.cameras[index], self._pair(index)
        asked = self.times[index], view_and_lens(camera, self.device), *(() if pair is None else (self.times[pair.to],))
        self._record_model(asked)
        means, quats, scales, opacities, features, loss, *there = self._recordings["field"](*asked)
        offsets = torch.zeros(len(means), 2, device=self.device, requires_grad=self.densifies)
        splats = Splats(means, quats, scales, opacities, features[:, :3], features[:, :0])
        render = rasterize(splats, features, camera, screen_offsets=offsets, clean=True)
        loss_of_picture, error = self._run("picture", self._picture_loss, render.image, render.alpha, frame.image, frame.valid, frame.depth)
        loss = loss + loss_of_picture
        if self.evidence is not None and pair is not None:
            seen = means, there[0], opacities, render.radii, render.image, render.alpha, *self.evidence.inputs(index, pair)
            (loss_of_motion,) = self._run("motion", motion_loss, *seen)
            loss = loss + config.flow * loss_of_motion
        if self.iteration % CURVES_EVERY == 0:
            loss = loss + self._recordings["curves"](self._curves_every)[0]
        if semantic_step:
            loss = loss + config.semantic * self._semantic_loss(index)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        self.optimizer.step()
        with torch.no_grad():
            self.running += torch.stack([loss.detach(), error])
            if offsets.grad is not None:
                self.density.observe(offsets.grad, render.radii, opacities, camera.width / 2)
                self.unseen.discard(index)
        self.iteration += 1
        self._edit()
        self._guard()
        self._watch()

    @property
    def _held(self) -> frozenset[int]:
        """Frames that are watched, not trained on, at this step."""
        return self.early.held_out(self.iteration)

    def _watch(self) -> None:
        """Look at the validation frames from time to time; cool down when they have stopped improving."""
        if self.iteration % WATCH_EVERY or not self._held or not self.deforms:
            return
        if self.early.observe(self.iteration, self.validation_psnr()):
            self.events(EarlyStopped(self.iteration, self.total, self.early.rule.reason))

    @torch.no_grad()
    def validation_psnr(self) -> float:
        """Mean over the watched frames, valid pixels, dB. What is drawn there is not pruned for not being seen in other frames."""
        scores = []
        for index in self.early.frames:
            frame = self.frames[index]
            splats = self.model.at(self.times[index], semantics=False).splats
            render = draw(splats, self.frames.cameras[index])
            self.density.observe_visible(render.radii, splats.opacities)
            error = (render.image[..., :3].clamp(0, 1) - frame.image.float() / 255).square()
            scores.append(-10 * torch.log10(error[frame.valid].mean().clamp_min(1e-10)))
        return float(torch.stack(scores).mean())

    def _record_model(self, asked: tuple[Tensor, ...]) -> None:
        """Record what reads the model, when the Gaussians or the stage have changed: before any gradient of this step is on its way."""
        if "field" in self._recordings:
            return
        self.optimizer.zero_grad(set_to_none=True)  # gradients lie where the forgotten recordings worked, which now is given back
        if self.device.type == "cuda":
            torch.cuda.empty_cache()
        if self.config.rigidity > 0 and self._neighbours is None:
            self._neighbours = nearest_neighbours(self.model.canonical["means"].detach(), NEIGHBOURS)
        parameters = list(self.model.parameters())
        field = FieldPass(self.model, self.config, self._neighbours, deform=self.deforms)
        self._recordings["field"] = recorded(field, asked, parameters)
        self._recordings["curves"] = recorded(CurvePass(self.model, self.config), (self._curves_every,), parameters)
        if self.semantics is not None:
            self._recordings["semantics"] = recorded(SemanticPass(self.model, self.config, deform=self.deforms), asked[:1], parameters)

    def _run(self, name: str, function: Callable[..., tuple[Tensor, ...]], *arguments: Tensor) -> tuple[Tensor, ...]:
        """A function of what was drawn, recorded at its first use."""
        if name not in self._recordings:
            self._recordings[name] = recorded(function, arguments)
        return self._recordings[name](*arguments)

    @property
    def progress(self) -> float:
        """How far the training has got, 0 to 1: what the learning rates follow."""
        return self.early.schedule.progress(self.iteration)

    @property
    def total(self) -> int:
        """Steps that will be made: those of the configuration, or fewer once the validation frames have stopped improving."""
        return self.early.schedule.total

    @property
    def deforms(self) -> bool:
        """False in the coarse stage, in which the first training frame is drawn from Gaussians that stand still."""
        return self.iteration >= self.config.coarse_iterations

    @property
    def densifies(self) -> bool:
        """Whether Gaussians are still cloned, split and pruned."""
        return self.progress < self.config.densify_until

    def _pair(self, frame: int) -> Pair | None:
        """One of the frames that the motion of this one is known to, at random."""
        if self.evidence is None or self.config.flow <= 0 or not (pairs := self.evidence.pairs[frame]):
            return None
        return pairs[int(self.random.integers(len(pairs)))]

    def _semantic_step(self) -> bool:
        return self.semantics is not None and self.iteration % self.config.semantic_every == 0

    def _next_frame(self, semantic_step: bool) -> int:
        """The first training frame in the coarse stage. Then all in a new random order each round; on a semantic step, the next one of
        them that has a teacher's word, if any.
        """
        if not self.deforms:
            return self.frames.clip.train_frames[0]
        if not self.order:
            self.order = [frame for frame in self.random.permutation(self.frames.clip.train_frames).tolist() if frame not in self._held]
        if semantic_step and self.semantics is not None:
            spoken = set(self.semantics.frames)
            for position in range(len(self.order) - 1, -1, -1):
                if self.order[position] in spoken:
                    return self.order.pop(position)
        return self.order.pop()

    def _semantic_loss(self, frame_index: int) -> Tensor:
        """The semantic pass, on this step's frame where the teacher speaks of it, else on another."""
        assert self.semantics is not None
        spoken = self.semantics.frames
        frame = frame_index if frame_index in set(spoken) else spoken[int(self.random.integers(len(spoken)))]
        means, quats, scales, opacities, latents, regularizer = self._recordings["semantics"](self.times[frame])
        splats = Splats(means, quats, scales, opacities, means.new_zeros(len(means), 3), latents)
        latent = draw_latents(splats, self.frames.cameras[frame], detached=self.config.routing == "isolated")
        return self.semantics.loss(latent, frame, use_angles=self.config.angular, region_weight=self.config.region) + regularizer

    # -- between steps ---------------------------------------------------------------------------------------------------------------------
    def _edit(self) -> None:
        config = self.config
        if self.iteration == config.coarse_iterations:
            self._forget_recordings()
        if self.iteration % config.densify_every or self.progress > config.densify_until:
            return
        prune = not self.unseen
        self.density.step(self.optimizer, self.generator, prune=prune)
        if prune:
            self.unseen = set(self.frames.clip.train_frames) - self._held
        self._neighbours = None
        self._forget_recordings()

    def _forget_recordings(self) -> None:
        """All but that of the picture, whose shapes never change."""
        self._recordings = {name: kept for name, kept in self._recordings.items() if name == "picture"}

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
        self.events(Rollback(self.iteration, f"values stopped being numbers at step {failed}; learning rates halved"))

    def report(self, steps: int) -> dict[str, Any]:
        """Mean loss and PSNR (training frames, valid pixels) over the last `steps` steps; forgets them."""
        loss, error = (self.running / max(steps, 1)).tolist()
        self.running.zero_()
        return {"loss": loss, "psnr": float(-10 * np.log10(max(error, 1e-12))), "gaussians": len(self.model)}


def draw(splats: Splats, camera: Camera) -> Render:
    """Colour and z in one pass: image [H, W, 4]."""
    features = torch.cat([splats.colors, camera_depths(splats.means, camera)[:, None]], 1)
    return rasterize(splats, features, camera)


def draw_latents(splats: Splats, camera: Camera, *, detached: bool) -> Tensor:
    """Latent map [H, W, d]. With `detached` geometry nothing but the latents receives a gradient."""
    return rasterize(splats.detach() if detached else splats, splats.semantics, camera).image


def run_steps(trainer: Trainer, stop: Callable[[], bool], every: int, after: Callable[[TrainingProgress], None]) -> bool:
    """Train to the end, or until `stop()`; call `after(report)` every `every` steps. True when it reached the end."""
    last, started, first = trainer.iteration, time.perf_counter(), trainer.iteration
    while trainer.iteration < trainer.total:
        if stop():
            return False
        trainer.step()
        total = trainer.total
        if trainer.iteration - last >= every or trainer.iteration == total:
            seconds = time.perf_counter() - started
            eta = seconds / max(1, trainer.iteration - first) * (total - trainer.iteration)
            values = trainer.report(trainer.iteration - last)
            last = trainer.iteration
            after(TrainingProgress(last, total, **values, seconds=seconds, eta=eta))
    return True
