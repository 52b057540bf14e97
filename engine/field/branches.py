"""The decoders of Z_kin: Ψ_geo, Ψ_sem, Ψ_app (paper Eq. 2), and the rigidly coupled baseline.

Every last layer starts at zero: an untrained field is the identity.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn


def decoder(inputs: int, outputs: int, width: int = 64) -> nn.Sequential:
    """Two-layer perceptron whose last layer is zero."""
    hidden, last = nn.Linear(inputs, width), nn.Linear(width, outputs)
    nn.init.kaiming_uniform_(hidden.weight, nonlinearity="relu")
    nn.init.zeros_(last.weight)
    nn.init.zeros_(last.bias)
    return nn.Sequential(hidden, nn.ReLU(inplace=True), last)


@dataclass
class Deformation:
    """ΔG_t of N Gaussians: what Ψ_geo adds to each canonical property.

    Attributes
    ----------
    means : float [N, 3]
        Scene units.
    log_scales : float [N, 3]
    quats : float [N, 4]
    opacities : float [N]
        On the logit.
    """

    means: Tensor
    log_scales: Tensor
    quats: Tensor
    opacities: Tensor

    @property
    def flat(self) -> Tensor:
        """All eleven numbers, [N, 11]."""
        return torch.cat([self.means, self.log_scales, self.quats, self.opacities[:, None]], 1)

    @classmethod
    def of(cls, flat: Tensor) -> Deformation:
        """From eleven numbers a Gaussian, [N, 11]: the inverse of `flat`."""
        return cls(flat[:, :3], flat[:, 3:6], flat[:, 6:10], flat[:, 10])


class GeometryBranch(nn.Module):
    """ΔG_t = Ψ_geo(Z_kin) (Eq. 2), [N, 11] in the order of `Deformation.flat`."""

    def __init__(self, latent: int):
        super().__init__()
        self.decode = decoder(latent, 11)

    def forward(self, latent: Tensor) -> Tensor:
        return self.decode(latent)


class SemanticBranch(nn.Module):
    """Δf_sem,t = Ψ_sem(Z_kin) (Eq. 2), optionally with a feature of its own planes beside Z_kin."""

    def __init__(self, latent: int, rank: int):
        super().__init__()
        self.decode = decoder(latent, rank)

    def forward(self, latent: Tensor) -> Tensor:
        return self.decode(latent)


class CoupledSemantics(nn.Module):
    """The rigid baseline, as in SurgTPGS-like systems: semantics as a function of decoded geometry, f_sem(t) = f_sem + C([ΔG_t, f_sem])."""

    def __init__(self, rank: int):
        super().__init__()
        self.decode = decoder(11 + rank, rank)

    def forward(self, deformation: Deformation, semantics: Tensor) -> Tensor:
        return self.decode(torch.cat([deformation.flat, semantics], 1))


class AppearanceBranch(nn.Module):
    """Δcolour_t = Ψ_app(Z_kin): charring and bleeding change colour in place, which otherwise only motion or fading could explain."""

    def __init__(self, latent: int):
        super().__init__()
        self.decode = decoder(latent, 3)

    def forward(self, latent: Tensor) -> Tensor:
        return self.decode(latent)
