"""Where Gaussians are missing and where they are useless: clone, split, prune, with a cap."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from degense.engine.field.model import CANONICAL, SceneModel
from degense.engine.training.adam import Adam

PRUNE_OPACITY = 0.005
GRADIENT_THRESHOLD = 2e-4  # of the screen position, in half-widths of the image, as in 3DGS
SPLIT_PIXELS = 12.0  # a Gaussian with a larger projected radius splits; a smaller one is cloned
SHRINK = 0.47  # ln 1.6: how much smaller the two halves of a split Gaussian are


class Density:
    """Collects evidence while training and edits the canonical Gaussians, of which there are never more than `cap`."""

    def __init__(self, model: SceneModel, cap: int):
        self.model, self.cap = model, cap
        self.reset()

    def reset(self) -> None:
        """Forget the evidence."""
        like = self.model.canonical["logits"]
        self.gradient = torch.zeros_like(like, requires_grad=False)
        self.seen = torch.zeros_like(self.gradient)
        self.opacity = torch.zeros_like(self.gradient)
        self.radius = torch.zeros_like(self.gradient)

    def state(self) -> dict[str, Tensor]:
        """Copies of the evidence."""
        return {name: getattr(self, name).clone() for name in ("gradient", "seen", "opacity", "radius")}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Go back to what `state` returned."""
        for name, value in state.items():
            setattr(self, name, value.to(self.gradient.device).clone())

    @torch.no_grad()
    def observe(self, screen_gradient: Tensor, radii: Tensor, opacities: Tensor, half_width: float) -> None:
        """Add one step: gradient of the loss by projected centre [N, 2] (per pixel), drawn radii [N] (pixels) and opacities [N]."""
        drawn = (radii > 0).to(self.opacity.dtype)
        torch.maximum(self.opacity, opacities.detach() * drawn, out=self.opacity)
        self.gradient += screen_gradient.norm(dim=1) * half_width * drawn
        self.seen += drawn
        torch.maximum(self.radius, radii.to(self.radius.dtype), out=self.radius)

    @torch.no_grad()
    def step(self, optimizer: Adam, generator: torch.Generator, *, prune: bool = True) -> dict[str, int]:
        """Prune what was never visible enough since the last pruning, then clone and split where the gradient is largest.

        `prune` only when every training frame was observed since the last pruning: what lives or is in view for a few frames of a long clip
        has not had its turn before. Until then its visibility is remembered; children begin with that of their parents. Returns how many
        were pruned, cloned and split.
        """
        canonical = self.model.canonical
        score = self.gradient / self.seen.clamp_min(1)
        keep = (self.opacity >= PRUNE_OPACITY) | (not prune)
        if int(keep.sum()) < 16:  # an all-masked or black stretch must not empty the scene
            keep = torch.ones_like(keep)
        room = max(0, self.cap - int(keep.sum()))
        wanted = keep & (score > GRADIENT_THRESHOLD)
        chosen = torch.where(wanted, score, torch.zeros_like(score)).topk(min(room, len(score), int(wanted.sum()))).indices
        split = chosen[self.radius[chosen] > SPLIT_PIXELS]
        clone = chosen[self.radius[chosen] <= SPLIT_PIXELS]

        offset = torch.randn((len(split), 3), generator=generator).to(canonical["means"].device)
        children = {name: canonical[name][torch.cat([clone, split])].clone() for name in CANONICAL}
        jump = rotate(canonical["quats"][split], offset * canonical["log_scales"][split].exp())
        children["means"][len(clone) :] += jump
        canonical["means"].data[split] -= jump
        children["log_scales"][len(clone) :] -= SHRINK
        canonical["log_scales"].data[split] -= SHRINK
        remembered = torch.cat([self.opacity[keep], self.opacity[torch.cat([clone, split])]])
        self._replace(optimizer, keep, children)
        self.reset()
        if not prune:
            self.opacity = remembered
        return {"pruned": int((~keep).sum()), "cloned": len(clone), "split": len(split)}

    def _replace(self, optimizer: Adam, keep: Tensor, children: dict[str, Tensor]) -> None:
        """Swap every canonical parameter for its kept rows and the children; Adam's moments follow, those of children start at zero."""
        for name in CANONICAL:
            old = self.model.canonical[name]
            new = torch.nn.Parameter(torch.cat([old.data[keep], children[name]]), old.requires_grad)
            self.model.canonical[name] = new
            for group in optimizer.param_groups:
                if group["params"][0] is old:
                    group["params"][0] = new
            state = optimizer.state.pop(old, None)
            if state:
                for key in ("exp_avg", "exp_avg_sq"):
                    state[key] = torch.cat([state[key][keep], torch.zeros_like(children[name])])
                optimizer.state[new] = state


def rotate(quats: Tensor, vectors: Tensor) -> Tensor:
    """Vectors [N, 3] turned by quaternions [N, 4] (wxyz, any non-zero length)."""
    q = torch.nn.functional.normalize(quats, dim=1)
    cross = torch.linalg.cross(q[:, 1:], vectors) * 2
    return vectors + q[:, :1] * cross + torch.linalg.cross(q[:, 1:], cross)
