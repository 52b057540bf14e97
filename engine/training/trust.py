"""How far single words of a teacher are believed, after all of them have been heard.

A coarse teacher mistakes one class for another in places and for a while. What the other frames say of the same tissue tells which words
are mistakes, and those then count less.
"""

from __future__ import annotations

import torch
from torch import Tensor

from engine.field import SceneModel
from engine.training.frames import TrainingFrames
from engine.training.semantics import SemanticTargets
from engine.training.trainer import draw_latents

DOUBT = 1.0  # 1 − cos at which a word counts a third; much less would silence what is true for a few frames only


@torch.no_grad()
def trust(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> dict[int, Tensor]:
    """For each frame the weight in [0, 1] of each of its target's words, float [k].

        w_j = mean over the pixels p of word j of exp((⟨F̃(p), ṽ_j⟩ − 1) / `DOUBT`)

    where F is what `model` has made of all frames' words together.
    """
    found = {}
    for frame in targets.frames:
        s = model.at(frames.clip.time(frame)).splats
        latent = draw_latents((s.means, s.quats, s.scales, s.opacities, s.semantics), frames.cameras[frame], detached=True)
        target = targets.target(frame)
        drawn = latent.reshape(-1, latent.shape[-1])[target.pixels]
        agreement = torch.cosine_similarity(drawn, target.latents[target.index], dim=1)
        count = torch.bincount(target.index, minlength=len(target.latents)).clamp_min(1)
        found[frame] = agreement.new_zeros(len(count)).index_add(0, target.index, torch.exp((agreement - 1) / DOUBT)) / count
    return found
