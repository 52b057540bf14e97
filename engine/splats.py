"""The state of all Gaussians at one instant: what a rasterizer draws and a checkpoint, a bake or a PLY holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass
class Splats:
    """N Gaussians at one time."""

    means: Float[Tensor, "n 3"]  # scene units
    quats: Float[Tensor, "n 4"]  # rotations, wxyz, of any non-zero length
    scales: Float[Tensor, "n 3"]  # standard deviations along the principal axes, scene units, positive
    opacities: Float[Tensor, " n"]  # in [0, 1]
    colors: Float[Tensor, "n 3"]  # RGB, nominally in [0, 1]
    semantics: Float[Tensor, "n d"]  # latent semantic vectors of any length; d may be 0

    def __len__(self) -> int:
        return self.means.shape[0]

    def map(self, change: Callable[[Tensor], Tensor]) -> Splats:
        """The splats with `change` applied to every tensor."""
        return Splats(**{f.name: change(getattr(self, f.name)) for f in fields(self)})

    def to(self, device: torch.device | str) -> Splats:
        return self.map(lambda tensor: tensor.to(device))

    def detach(self) -> Splats:
        return self.map(Tensor.detach)
