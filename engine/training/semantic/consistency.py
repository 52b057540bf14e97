"""How far a teacher is believed, after all of its words have been heard.

A teacher mistakes one class for another in places and for a while. What the other frames say of the same tissue tells which words are
mistakes. The single words of a coarse teacher then count less; a pixelwise one has a word for all pixels of a class, so it is believed
less as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.passes import draw_latents
from degense.engine.training.semantic.targets import SemanticTargets, Target, alike

DOUBT = 0.2  # 1 − cos at which a word counts a third
KINDS = 2000  # words of all frames that stand for all kinds


@torch.no_grad()
def trust(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> dict[int, Tensor]:
    """For each frame the weight of each of its target's words, float [k], about 1 on the mean of every kind of word.

        w_j = m_j / Σ_l κ_jl n_l m_l · Σ_l κ_jl n_l        m_j = mean of exp((⟨F̃(p), ṽ_j⟩ − 1) / `DOUBT`) over the n_j pixels of word j

    where F is what `model` has made of all frames' words together, and κ_jl how far two words are `alike`. Dividing by the mean of its kind
    keeps what is rarely seen from being outvoted: a thin instrument that moves is doubted in all of its words.
    """
    words, sizes, totals = [], [], []
    for target, agreement in _agreements(model, targets, frames):
        size = torch.bincount(target.index, minlength=len(target.latents)).float()
        words.append(torch.nn.functional.normalize(target.latents, dim=1))
        sizes.append(size)
        totals.append(size.new_zeros(len(size)).index_add(0, target.index, agreement))
    kinds, many, believed = (torch.cat(parts) for parts in (words, sizes, totals))
    some = torch.linspace(0, len(kinds) - 1, min(KINDS, len(kinds)), device=kinds.device).long()
    found = {}
    for frame, word, size, total in zip(targets.frames, words, sizes, totals, strict=True):
        kin = alike(word, kinds[some])
        usual = (kin @ believed[some]) / (kin @ many[some]).clamp_min(1e-9)
        found[frame] = total / size.clamp_min(1) / usual.clamp_min(1e-3)
    return found


@torch.no_grad()
def consent(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> float:
    """Mean of exp((⟨F̃(p), ṽ⟩ − 1) / `DOUBT`) over all that is said of all pixels: 1 where all frames' words agree with one another.

    Label maps reach .97 on the phantoms, and .5 once a quarter of their regions is mistaken.
    """
    agreed = [(float(agreement.sum()), len(agreement)) for _, agreement in _agreements(model, targets, frames)]
    total, count = (sum(part) for part in zip(*agreed, strict=True))
    return total / max(count, 1)


def _agreements(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> Iterator[tuple[Target, Tensor]]:
    """Each frame's target, and how far each of its pixels' words agrees with what the model shows there, float [P] in (0, 1]."""
    for frame in targets.frames:
        s = model.at(frames.clip.time(frame)).splats
        latent = draw_latents(s, frames.cameras[frame], detached=True)
        target = targets.target(frame)
        drawn = latent.reshape(-1, latent.shape[-1])[target.pixels]
        yield target, torch.exp((torch.cosine_similarity(drawn, target.latents[target.index], dim=1) - 1) / DOUBT)
