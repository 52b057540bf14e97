"""Meaning for a finished geometry: what the teacher said of all frames is lifted to the Gaussians at once, then refined.

With routing `isolated` no semantic gradient may reach geometry, so geometry need not wait for meaning nor pay for it: all semantic
supervision comes after it, on Gaussians that neither move on nor multiply any more. A run from zero follows the errors of single
frames; the mean over all frames, which is known in closed form, does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from degense.engine.cuda_graphs import graphed
from degense.engine.field import SceneModel
from degense.engine.progress import Progress, silent
from degense.engine.raster import backproject
from degense.engine.splats import Splats
from degense.engine.training.config import TrainConfig
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.passes import SemanticPass, draw_latents
from degense.engine.training.semantic.consistency import consent, trust
from degense.engine.training.semantic.targets import SemanticTargets

TELL_EVERY = 25  # steps
#: What is left of the learning rates after a lift: canonical latents, planes, networks. A coarse teacher's frames contradict each other;
#: steps as large as from nothing, or twice as many, would follow each of them in turn and lose what their mean says.
GENTLE = (0.3, 0.05, 0.1)
CONSENT = 0.8  # of a pixelwise teacher's words with each other, from which on each frame is followed
LOOK_RIDGE = 5e-4  # variance of a Gaussian's colour, of 1, below which its look does not explain what is said of it


class Heard(NamedTuple):
    """What the teacher says of each of N Gaussians in one frame.

    Attributes
    ----------
    said : float [N, d]
        Σ_p w_p a_ip v_p: a_ip is the share of Gaussian i in pixel p, w_p the target's weight, v_p its vector.
    share : float [N]
        Σ_p w_p a_ip: how much of it was spoken of.
    recoloured : float [N, 3]
        Δcolour: how it looked then, beside its canonical colour.
    """

    said: Tensor
    share: Tensor
    recoloured: Tensor


def heard(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames, progress: Progress = silent) -> Iterator[Heard]:
    """All that the teacher says, frame by frame."""
    for done, i in enumerate(targets.frames):
        progress(done / len(targets.frames), "lifting the teacher's words")
        with torch.no_grad():
            s = model.at(frames.clip.time(i), semantics=False).splats
        target = targets.target(i)
        camera = frames.cameras[i]
        values = s.means.new_zeros(camera.height * camera.width, target.latents.shape[1])
        weight = s.means.new_zeros(len(values))
        values[target.pixels], weight[target.pixels] = target.latents[target.index], target.weight
        shape = (camera.height, camera.width)
        total, share = backproject(s, values.reshape(*shape, -1), camera, confidence=weight.reshape(shape))
        yield Heard(total, share, s.colors - model.canonical["colors"].detach())


def lift(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames, progress: Progress = silent) -> tuple[Tensor, Tensor]:
    """Canonical latents and how they follow colour, from all that the teacher says of the pixels a Gaussian shows.

    A Gaussian that always looks the same gets the mean of all frames. One that changed its look (charred, bled over, an instrument that
    came over it) gets the line through what was said of it at each look, by ridge regression over the frames:

        f_i(t) = f_i + R_iᵀ Δc_i(t)        R_i = (Σ_cc + λI)⁻¹ Σ_cv        f_i = v̄_i − R_iᵀ c̄_i

    with means and covariances weighted by its share in each frame, scaled so that v̄_i has unit length.

    Returns
    -------
    latents : float [N, d]
        f_i; zero for Gaussians never seen where the teacher speaks.
    semantic_coefficients : float [N, 3, d]
        R_i.
    """
    count, rank = model.canonical["semantics"].shape
    moments = model.bounds.new_zeros(count, 4, rank + 4)  # Σ share (1, c)ᵀ (v, 1, c): all sums of the line at once
    for said, share, colour in heard(model, targets, frames, progress):
        view_state = torch.nn.functional.pad(colour, (1, 0), value=1.0)
        moments += view_state[:, :, None] * torch.cat([said, share[:, None] * view_state], 1)[:, None]
    moments = moments / moments[:, :1, rank : rank + 1].clamp_min(1e-12)
    words, view_state = moments[:, 0, :rank], moments[:, 0, rank + 1 :]
    both = moments[:, 1:, :rank] - view_state[:, :, None] * words[:, None]
    colours = moments[:, 1:, rank + 1 :] - view_state[:, :, None] * view_state[:, None]
    semantic_coefficients = torch.linalg.solve(colours + LOOK_RIDGE * torch.eye(3, device=view_state.device), both)
    length = words.norm(dim=1).clamp_min(1e-12)[:, None]
    latents = (words - (view_state[:, :, None] * semantic_coefficients).sum(1)) / length
    return latents, semantic_coefficients / length[:, None]


def fit_meaning(
    model: SceneModel,
    targets: SemanticTargets,
    frames: TrainingFrames,
    config: TrainConfig,
    stop: Callable[[], bool] = lambda: False,
    progress: Progress = silent,
) -> bool:
    """Train everything semantic of `model` in place, nothing else; False when `stop()` asked to leave.

    Parameters
    ----------
    config : TrainConfig
        `lift`, `semantic_steps`, `angular`, `region`, `delta_semantics` and the learning rates.
    """
    random = np.random.default_rng(config.seed)
    if config.lift:
        _settle(model, *lift(model, targets, frames, lambda f, words: progress((0.2 if targets.pixelwise else 0.1) * f, words)))
    gentle = config.lift and (not targets.pixelwise or consent(model, targets, frames) < CONSENT)
    targets.doubted = gentle and targets.pixelwise
    if gentle and config.angular and not targets.pixelwise:
        targets.trust = trust(model, targets, frames)
        _settle(model, *lift(model, targets, frames, lambda f, words: progress(0.1 + 0.1 * f, words)))
    loss_of, spoken = (targets.patch_loss, targets.spoken) if targets.shared else (targets.loss, targets.frames)
    steps, order = min(config.semantic_steps, config.iterations), list[int]()  # a training cut short is cut short here too
    if gentle:
        steps //= 2
    with _only_meaning(model, config, gentle=gentle) as optimizer:
        moments = {frame: torch.full((), frames.clip.time(frame), device=model.bounds.device) for frame in spoken}
        scene = graphed(SemanticPass(model, config, deform=True), (moments[spoken[0]],), list(model.parameters()))
        for step in range(steps):
            if stop():
                model.semantic_coefficients = None  # a resumed training lifts again
                return False
            for group in optimizer.param_groups:
                group["lr"] = group["first"] * config.rate_final ** (step / steps)
            order = order or [spoken[k] for k in random.permutation(len(spoken))]
            frame = order.pop()
            means, quats, scales, opacities, latents, regularizer = scene(moments[frame])
            splats = Splats(means, quats, scales, opacities, means.new_zeros(len(means), 3), latents)
            latent = draw_latents(splats, frames.cameras[frame], detached=True)
            terms = loss_of(latent, frame, use_angles=config.angular, region_weight=config.region)
            loss = sum(terms.values()) + regularizer / config.semantic
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
            if step % TELL_EVERY == 0:
                progress(0.2 + 0.8 * step / steps, "refining meaning")
    return True


def _settle(model: SceneModel, latents: Tensor, semantic_coefficients: Tensor) -> None:
    """Give the Gaussians what `lift` found."""
    model.canonical["semantics"].data.copy_(latents)
    model.set_semantic_coefficients(semantic_coefficients)


@contextmanager
def _only_meaning(model: SceneModel, config: TrainConfig, *, gentle: bool) -> Iterator[torch.optim.Adam]:
    """An optimiser of the semantic parameters; all others need no gradient meanwhile."""
    planes, networks = ([] if part is None else list(part.parameters()) for part in (model.semantic_planes, model.semantic))
    slower = GENTLE if gentle else (1.0, 1.0, 1.0)
    rates = (config.rate_semantics, config.rate_planes, config.rate_field)
    parts = ([model.canonical["semantics"]], planes, networks)
    groups = [{"params": part, "lr": rate * s, "first": rate * s} for part, rate, s in zip(parts, rates, slower, strict=True) if part]
    meaning = {id(parameter) for part in parts for parameter in part}
    others = [parameter for parameter in model.parameters() if id(parameter) not in meaning and parameter.requires_grad]
    for parameter in others:
        parameter.requires_grad_(False)
    try:
        yield torch.optim.Adam(groups, eps=1e-15, fused=True)
    finally:
        for parameter in others:
            parameter.requires_grad_(True)
