"""How far single words of a teacher are believed, after all of them have been heard.

A coarse teacher mistakes one class for another in places and for a while. What the other frames say of the same tissue tells which words
are mistakes, and those then count less.
"""

from __future__ import annotations

import torch
from torch import Tensor

from engine.field import SceneModel
from engine.training.frames import TrainingFrames
from engine.training.semantics import SemanticTargets, alike
from engine.training.trainer import draw_latents

DOUBT = 0.2  # 1 − cos at which a word counts a third
KINDS = 2000  # words of all frames that stand for all kinds


@torch.no_grad()
def trust(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> dict[int, Tensor]:
    """For each frame the weight of each of its target's words, float [k], about 1 on the mean of every kind of word.

        w_j = m_j / Σ_l κ_jl n_l m_l · Σ_l κ_jl n_l        m_j = mean of exp((⟨F̃(p), ṽ_j⟩ − 1) / `DOUBT`) over the n_j pixels of word j

    where F is what `model` has made of all frames' words together, and κ_jl how far two words are `alike`. Dividing by the mean of its kind
    keeps what is rarely seen from being outvoted: a thin instrument that moves is doubted in all of its words.
    """
    words, sizes, doubted = [], [], []
    for frame in targets.frames:
        s = model.at(frames.clip.time(frame)).splats
        latent = draw_latents((s.means, s.quats, s.scales, s.opacities, s.semantics), frames.cameras[frame], detached=True)
        target = targets.target(frame)
        drawn = latent.reshape(-1, latent.shape[-1])[target.pixels]
        agreement = torch.cosine_similarity(drawn, target.latents[target.index], dim=1)
        size = torch.bincount(target.index, minlength=len(target.latents)).float()
        total = size.new_zeros(len(size)).index_add(0, target.index, torch.exp((agreement - 1) / DOUBT))
        words.append(torch.nn.functional.normalize(target.latents, dim=1))
        sizes.append(size)
        doubted.append(total)
    kinds, many, believed = (torch.cat(parts) for parts in (words, sizes, doubted))
    some = torch.linspace(0, len(kinds) - 1, min(KINDS, len(kinds)), device=kinds.device).long()
    found = {}
    for frame, word, size, total in zip(targets.frames, words, sizes, doubted, strict=True):
        kin = alike(word, kinds[some])
        usual = (kin @ believed[some]) / (kin @ many[some]).clamp_min(1e-9)
        found[frame] = total / size.clamp_min(1) / usual.clamp_min(1e-3)
    return found
