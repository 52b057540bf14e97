"""Semantic distillation onto a finished geometry: all frames' labels are back-projected to the Gaussians at once, then refined.

With routing `isolated` no semantic gradient reaches geometry, so all semantic supervision comes after it, on Gaussians that neither move
nor multiply any more. Training from zero would follow the errors of single frames; the mean over all frames, in closed form, does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.field.cuda_graphs import graphed
from degense.engine.profile import part, renamed_at_gradient
from degense.engine.progress import Progress, silent
from degense.engine.threads import made_ahead, one_torch_thread
from degense.engine.training.adam import Adam
from degense.engine.training.config import TrainConfig
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.loss_terms import Loss, LossSums
from degense.engine.training.losses import angular, l1
from degense.engine.training.passes import SemanticPass
from degense.engine.training.semantic.consensus import Consensus
from degense.engine.training.semantic.finished import FinishedGeometry, FinishedLatents
from degense.engine.training.semantic.targets import SemanticTargets

REPORT_EVERY = 25  # steps
#: Gets the steps made, all that will be made, and means of the loss and of its terms by name over the steps since the last report.
Report = Callable[[int, int, float, dict[str, float]], object]
COLOR_RIDGE = 5e-4  # variance of a Gaussian's colour, of 1, below which its colour does not explain its labels


class BackProjectedTarget(NamedTuple):
    """One frame's target on N Gaussians: w_ip is the share of Gaussian i in pixel p, m_p the target's weight, v_p its vector."""

    total: Tensor  # float [N, d]; Σ_p m_p w_ip v_p
    weight: Tensor  # float [N]; Σ_p m_p w_ip
    color_change: Tensor  # float [N, 3]; Δcolour at that time, beside the canonical colour


def backprojected_targets(
    geometry: FinishedGeometry, targets: SemanticTargets, progress: Progress = silent
) -> Iterator[BackProjectedTarget]:
    """The targets of all frames, one after the other, on the Gaussians."""
    canonical = geometry.model.canonical["colors"].detach()
    for done, (i, target) in enumerate(zip(targets.frames, made_ahead(targets.target, targets.frames), strict=True)):
        progress(done / len(targets.frames), "back-projecting labels")
        shape = geometry.frames.size[::-1]
        total, weight = geometry.placed(i).backproject(target.wanted.reshape(*shape, -1), target.weight.reshape(shape))
        yield BackProjectedTarget(total, weight, geometry.splats(i).colors - canonical)


def backproject_features(geometry: FinishedGeometry, targets: SemanticTargets, progress: Progress = silent) -> tuple[Tensor, Tensor]:
    """Canonical latents and how they follow colour, from all labels of the pixels that a Gaussian shows.

    A Gaussian of constant colour gets the mean of all frames. One whose colour changes (charred, bled over, covered by an instrument) gets
    the line through its labels at each colour, by ridge regression over the frames:

        f_i(t) = f_i + R_iᵀ Δc_i(t)        R_i = (Σ_cc + λI)⁻¹ Σ_cv        f_i = v̄_i − R_iᵀ c̄_i

    with means and covariances weighted by its share in each frame, scaled so that v̄_i has unit length.

    Returns f [N, d], zero for Gaussians never seen at a labelled pixel, and R [N, 3, d].
    """
    count, rank = geometry.model.canonical["semantics"].shape
    moments = geometry.model.bounds.new_zeros(count, 4, rank + 4)  # Σ weight (1, c)ᵀ (v, 1, c): all sums of the line at once
    for total, weight, color_change in backprojected_targets(geometry, targets, progress):
        regressors = torch.nn.functional.pad(color_change, (1, 0), value=1.0)
        moments += regressors[:, :, None] * torch.cat([total, weight[:, None] * regressors], 1)[:, None]
    moments = moments / moments[:, :1, rank : rank + 1].clamp_min(1e-12)
    labels, colors = moments[:, 0, :rank], moments[:, 0, rank + 1 :]
    covariance = moments[:, 1:, :rank] - colors[:, :, None] * labels[:, None]
    variance = moments[:, 1:, rank + 1 :] - colors[:, :, None] * colors[:, None]
    semantic_coefficients = torch.linalg.solve(variance + COLOR_RIDGE * torch.eye(3, device=colors.device), covariance)
    length = labels.norm(dim=1).clamp_min(1e-12)[:, None]
    latents = (labels - (colors[:, :, None] * semantic_coefficients).sum(1)) / length
    return latents, semantic_coefficients / length[:, None]


def steps_of(config: TrainConfig) -> int:
    """Steps of a distillation, at most: a training cut short is cut short here too."""
    return min(config.semantic_steps, config.iterations)


@one_torch_thread()
def distill(
    model: SceneModel,
    targets: SemanticTargets,
    frames: TrainingFrames,
    config: TrainConfig,
    stop: Callable[[], bool] = lambda: False,
    progress: Progress = silent,
    report: Report = lambda *_: None,
) -> bool:
    """Train everything semantic of `model` in place, nothing else; False when `stop()` asked to leave.

    Of the config it reads `consensus`, `lift`, `semantic_steps`, `angular`, `region`, `delta_semantics` and the learning rates. `report` is
    called every `REPORT_EVERY` steps and at the end.
    """
    random, geometry = np.random.default_rng(config.seed), FinishedGeometry(model, frames)
    if config.consensus and not targets.sparse:
        with part("consensus"):
            consensus = Consensus(geometry, targets, config.seed, lambda f, text: progress(0.3 * f, text))
        targets.rightness = consensus.rightness
        targets = targets.replaced(consensus.answer)
    if config.lift:
        with part("back-projection"):
            latents, coefficients = backproject_features(geometry, targets, lambda f, text: progress(0.3 + 0.1 * f, text))
        model.canonical["semantics"].data.copy_(latents)
        model.set_semantic_coefficients(coefficients)
    distance, labelled = angular if config.angular else l1, targets.frames
    steps, order = steps_of(config), list[int]()
    with _semantic_optimizer(model, config) as optimizer:
        sums, zero = LossSums(model.bounds.device), torch.zeros((), device=model.bounds.device)
        latents_of = _latents_of(geometry, config, labelled)
        for step in range(steps):
            if stop():
                model.semantic_coefficients = None  # a resumed training back-projects again
                return False
            for group in optimizer.param_groups:
                group["lr"] = group["first"] * config.rate_final ** (step / steps)
            order = order or [labelled[k] for k in random.permutation(len(labelled))]
            frame = order.pop()
            with part("field"):
                latents, regularizer = latents_of(frame)
            with part("raster"):
                latent = geometry.placed(frame).draw(latents)
            renamed_at_gradient(latents, "field backward")
            renamed_at_gradient(latent, "raster backward")
            with part("losses"):
                terms = {**targets.loss(latent, frame, distance, config.region), "delta_semantics": regularizer / config.semantic}
                loss = Loss.of("semantic", terms, zero)
            optimizer.zero_grad()
            with part("losses backward"):
                loss.total.backward()
            with part("optimiser"):
                optimizer.step()
            sums.add(loss.total, zero, {"semantic": loss})
            if step % REPORT_EVERY == 0:
                progress(0.4 + 0.6 * step / steps, "refining semantics")
            if (step + 1) % REPORT_EVERY == 0 or step + 1 == steps:
                mean, _, by_name = sums.means(step % REPORT_EVERY + 1)
                report(step + 1, steps, mean, by_name)
    return True


def _latents_of(geometry: FinishedGeometry, config: TrainConfig, labelled: Sequence[int]) -> Callable[[int], tuple[Tensor, Tensor]]:
    """The latents of the Gaussians at a frame, and the regularizer of how these change: what need not be computed again is kept where
    that is quicker than the graph of a GPU."""
    model, times, device = geometry.model, geometry.frames.clip.time, geometry.model.bounds.device
    if device.type == "cpu" and model.config.routing == "isolated" and model.moving is None:
        return FinishedLatents(geometry, config)
    moments = {frame: torch.full((), times(frame), device=device) for frame in labelled}
    graph = graphed(SemanticPass(model, config, deform=True), (moments[labelled[0]],), list(model.parameters()))

    def latents_of(frame: int) -> tuple[Tensor, Tensor]:
        *_, latents, regularizer = graph(moments[frame])
        return latents, regularizer

    return latents_of


@contextmanager
def _semantic_optimizer(model: SceneModel, config: TrainConfig) -> Iterator[Adam]:
    """An optimiser of the semantic parameters; all others need no gradient meanwhile."""
    planes, networks = ([] if part is None else list(part.parameters()) for part in (model.semantic_planes, model.semantic))
    rates = (config.rate_semantics, config.rate_planes, config.rate_field)
    parts = ([model.canonical["semantics"]], planes, networks)
    groups = [{"params": part, "lr": rate, "first": rate} for part, rate in zip(parts, rates, strict=True) if part]
    semantic = {id(parameter) for part in parts for parameter in part}
    others = [parameter for parameter in model.parameters() if id(parameter) not in semantic and parameter.requires_grad]
    for parameter in others:
        parameter.requires_grad_(False)
    try:
        yield Adam(groups)
    finally:
        for parameter in others:
            parameter.requires_grad_(True)


#: What fits semantics to a finished geometry in place, called as `distill` is, by the setting `distillation`. Experiments add their own.
DISTILLATIONS: dict[str, Callable[..., bool]] = {"gaussians": distill}
