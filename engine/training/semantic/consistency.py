"""How far a coarse teacher's labels agree with each other over the whole clip, and how much each of them counts.

A teacher mistakes one class for another in places and for a while. The labels of the same tissue in other frames show which are mistakes.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.passes import draw_latents
from degense.engine.training.semantic.targets import SemanticTargets, Target
from degense.engine.training.semantic.vectors import alike

AGREEMENT_SCALE = 0.2  # 1 − cos at which a label counts a third
KIND_SAMPLES = 2000  # labels of all frames that stand for all kinds


@torch.no_grad()
def label_confidence(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> dict[int, Tensor]:
    """For each frame the confidence of each of its target's labels, float [k], about 1 on the mean of every kind of label.

        w_j = m_j / Σ_l κ_jl n_l m_l · Σ_l κ_jl n_l        m_j = mean of exp((⟨F̃(p), ṽ_j⟩ − 1) / `AGREEMENT_SCALE`) over j's n_j pixels

    where F is what `model` has made of all frames' labels together, and κ_jl how far two labels are `alike`. Dividing by the mean of its
    kind keeps what is rarely seen from being outvoted: all labels of a thin instrument that moves agree less.
    """
    labels, sizes, totals = [], [], []
    for target, agreement in _agreements(model, targets, frames):
        size = torch.bincount(target.index, minlength=len(target.latents)).float()
        labels.append(torch.nn.functional.normalize(target.latents, dim=1))
        sizes.append(size)
        totals.append(size.new_zeros(len(size)).index_add(0, target.index, agreement))
    all_labels, all_sizes, all_totals = (torch.cat(parts) for parts in (labels, sizes, totals))
    sample = torch.linspace(0, len(all_labels) - 1, min(KIND_SAMPLES, len(all_labels)), device=all_labels.device).long()
    found = {}
    for frame, label, size, total in zip(targets.frames, labels, sizes, totals, strict=True):
        kin = alike(label, all_labels[sample])
        usual = (kin @ all_totals[sample]) / (kin @ all_sizes[sample]).clamp_min(1e-9)
        found[frame] = total / size.clamp_min(1) / usual.clamp_min(1e-3)
    return found


def _agreements(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> Iterator[tuple[Target, Tensor]]:
    """Each frame's target, and how far each of its pixels' labels agrees with the model's latent there, float [P] in (0, 1]."""
    for frame in targets.frames:
        splats = model.at(frames.clip.time(frame)).splats
        latent = draw_latents(splats, frames.cameras[frame], detached=True)
        target = targets.target(frame)
        drawn = latent.reshape(-1, latent.shape[-1])[target.pixels]
        yield target, torch.exp((torch.cosine_similarity(drawn, target.latents[target.index], dim=1) - 1) / AGREEMENT_SCALE)
