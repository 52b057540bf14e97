"""Which Gaussians the field leaves in their place or static, so that these need not enter it again."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from degense.engine.field.model import SceneModel

PIXELS = 0.05  # how far a Gaussian's centre may move and still count as static
SHAPE, OPACITY, COLOR = 0.02, 0.01, 0.5 / 255  # greatest change of log-scale and quaternion, of opacity, of colour
LATENT = 0.02  # of a latent, as a share of its length


@torch.no_grad()
def keep_still(model: SceneModel, times: Sequence[float], focal: float, told: float) -> None:
    """Let persistent Gaussians keep their mean place that at all of `times` are within `told` pixels of where they are at the first.

    `focal` as in `find_moving`. The field goes on to change their shape and colour.
    """
    if model.config.static:
        return
    first = model.means_at(times[0])
    farthest, total = first.new_zeros(len(model)), torch.zeros_like(first)
    for t in times:
        means = model.means_at(t)
        farthest, total = torch.maximum(farthest, (means - first).norm(dim=1)), total + means
    still = model.persistent & (farthest * focal <= told)
    model.canonical["means"].copy_(torch.where(still[:, None], total / len(times), model.canonical["means"]))
    model.set_still(still)


@torch.no_grad()
def find_moving(model: SceneModel, times: Sequence[float], focal: float) -> Tensor:
    """Rows of the Gaussians that the field changes visibly at any of `times`, int64 [M].

    Leaving out the others changes a render by less than a twentieth of a pixel, a hundredth of opacity and half a grey level a Gaussian.
    `focal` is in pixels: at the scene's unit depth a length d covers `focal` · d of them.
    """
    if model.config.static:
        return torch.zeros(0, dtype=torch.int64, device=model.bounds.device)
    before, model.moving = model.moving, None
    latents = model.canonical["semantics"]
    moves = torch.zeros(len(model), dtype=torch.bool, device=latents.device)
    opacities = model.canonical["logits"].sigmoid()
    for t in times:
        state = model.at(t)
        assert state.deformation is not None
        d = state.deformation
        moves |= d.means.norm(dim=1) * focal > PIXELS
        moves |= (d.log_scales.abs().amax(1) > SHAPE) | (d.quats.abs().amax(1) > SHAPE * model.canonical["quats"].norm(dim=1))
        moves |= ((model.canonical["logits"] + d.opacities).sigmoid() - opacities).abs() > OPACITY
        if state.delta_color is not None:
            moves |= state.delta_color.abs().amax(1) > COLOR
        if state.delta_semantics is not None:
            moves |= state.delta_semantics.norm(dim=1) > LATENT * latents.norm(dim=1)
    model.moving = before
    return moves.nonzero()[:, 0]
