"""Meaning for a finished geometry: what the teacher said of all frames is lifted to the Gaussians at once, then refined.

With routing `isolated` no semantic gradient may reach geometry, so geometry need not wait for meaning nor pay for it: all semantic
supervision comes after it, on Gaussians that neither move on nor multiply any more. A run from zero follows the errors of single
frames; the mean over all frames, which is known in closed form, does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import torch
from torch import Tensor

from engine.field import SceneModel
from engine.progress import Progress, silent
from engine.raster import rasterize
from engine.training.config import TrainConfig
from engine.training.frames import TrainingFrames
from engine.training.semantics import SemanticTargets
from engine.training.trainer import draw_latents

TELL_EVERY = 25  # steps
#: What is left of the learning rates after a lift: canonical latents, planes, networks. A coarse teacher's frames contradict each other;
#: steps as large as from nothing would follow each of them in turn and lose what their mean says. A pixelwise teacher is followed.
GENTLE = (0.1, 0.25, 0.3)


def lift(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames, progress: Progress = silent) -> Tensor:
    """Canonical latents [N, d]: for each Gaussian the mean of what the teacher says of the pixels it shows, over all frames.

    Unit length; zero for Gaussians never seen where the teacher speaks.
    """
    return torch.nn.functional.normalize(heard(model, targets, frames, progress), dim=1)


def heard(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames, progress: Progress = silent) -> Tensor:
    """All that the teacher says of each Gaussian, [N, d]: Σ_t Σ_p w_p a_ip(t) v_p(t).

    a_ip is the share of Gaussian i in pixel p and w_p the target's weight. A picture is linear in the features that it blends, so the
    inner sum is the gradient of Σ_p w_p ⟨F(p), v_p⟩ by f_i: one backward pass a frame.
    """
    total = torch.zeros_like(model.canonical["semantics"])
    for done, i in enumerate(targets.frames):
        progress(done / len(targets.frames), "lifting the teacher's words")
        with torch.no_grad():
            s = model.at(frames.clip.time(i), semantics=False).splats
        features = torch.zeros_like(total, requires_grad=True)
        target = targets.target(i)
        picture = rasterize(s.means, s.quats, s.scales, s.opacities, features, frames.cameras[i]).image
        wanted = target.latents[target.index] * target.weight[:, None]
        said = (picture.reshape(-1, total.shape[1])[target.pixels] * wanted).sum()
        total += torch.autograd.grad(said, features)[0]
    return total


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
        `lift`, `semantic_steps`, `angular`, `region`, `resemantics` and the learning rates.
    """
    random = np.random.default_rng(config.seed)
    if config.lift:
        model.canonical["semantics"].data.copy_(lift(model, targets, frames, lambda f, words: progress(0.2 * f, words)))
    steps, order = min(config.semantic_steps, config.iterations), list[int]()  # a training cut short is cut short here too
    with _only_meaning(model, config, gentle=config.lift and not targets.pixelwise) as optimizer:
        for step in range(steps):
            if stop():
                return False
            for group in optimizer.param_groups:
                group["lr"] = group["first"] * config.rate_final ** (step / steps)
            order = order or [targets.frames[k] for k in random.permutation(len(targets.frames))]
            frame = order.pop()
            state = model.at(frames.clip.time(frame))
            s = state.splats
            latent = draw_latents((s.means, s.quats, s.scales, s.opacities, s.semantics), frames.cameras[frame], detached=True)
            loss = targets.loss(latent, frame, use_angles=config.angular, region_weight=config.region)
            if state.resemantics is not None:
                loss = loss + config.resemantics / config.semantic * state.resemantics.abs().mean()
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()
            if step % TELL_EVERY == 0:
                progress(0.2 + 0.8 * step / steps, "refining meaning")
    return True


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
        yield torch.optim.Adam(groups, eps=1e-15)
    finally:
        for parameter in others:
            parameter.requires_grad_(True)
