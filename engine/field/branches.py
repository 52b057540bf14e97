"""From a HexPlane feature to the kinematic latent Z_kin (paper Eq. 1), and the branches that decode it (Eq. 2)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

PROPERTIES = ("pos", "scale", "rot", "opa")
DEFORMATION = 11  # numbers of a `Deformation`
WIDTH, STATE = 64, 16  # lengths of h_base, and of hidden layers, and of each φ_k(h_base)


class Kinematics(nn.Module):
    """h_base = base(h_st);  Z_kin = ⊕_k φ_k(h_base), k ∈ {pos, scale, rot, opa} (Eq. 1); h_st has `feature` numbers.

    φ_k is linear where `linear`, as in the paper; else rectified.
    """

    def __init__(self, feature: int, *, linear: bool = False):
        super().__init__()
        self.linear = linear
        self.base = nn.Sequential(nn.Linear(feature, WIDTH), nn.ReLU(inplace=True), nn.Linear(WIDTH, WIDTH), nn.ReLU(inplace=True))
        # The four maps share their input: one matrix holds them as blocks of rows, in the order of PROPERTIES.
        self.states = nn.Linear(WIDTH, STATE * len(PROPERTIES))
        for layer in (*self.base, self.states):
            if isinstance(layer, nn.Linear):
                nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu")

    @property
    def dimension(self) -> int:
        return self.states.out_features

    def forward(self, feature: Tensor) -> Tensor:
        """Z_kin [N, 4 STATE] of h_st [N, feature]."""
        states = self.states(self.base(feature))
        return states if self.linear else torch.relu_(states)


class Branch(nn.Module):
    """A two-layer perceptron whose last layer starts at zero, so that an untrained field is the identity.

    Ψ_geo: Z_kin → ΔG_t, Ψ_sem: Z_kin → Δf_sem (Eq. 2), Ψ_app: Z_kin → Δcolour; in the coupled baseline [ΔG_t, f_sem] → Δf_sem.
    """

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        hidden, last = nn.Linear(inputs, WIDTH), nn.Linear(WIDTH, outputs)
        nn.init.kaiming_uniform_(hidden.weight, nonlinearity="relu")
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.decode = nn.Sequential(hidden, nn.ReLU(inplace=True), last)

    def forward(self, inputs: Tensor) -> Tensor:
        return self.decode(inputs)


@dataclass
class Deformation:
    """ΔG_t of N Gaussians: what Ψ_geo adds to each canonical property."""

    means: Float[Tensor, "n 3"]  # scene units
    log_scales: Float[Tensor, "n 3"]
    quats: Float[Tensor, "n 4"]
    opacities: Float[Tensor, " n"]  # on the logit

    @property
    def flat(self) -> Tensor:
        """All eleven numbers, [N, 11]."""
        return torch.cat([self.means, self.log_scales, self.quats, self.opacities[:, None]], 1)

    @classmethod
    def of(cls, flat: Tensor) -> Deformation:
        """From eleven numbers a Gaussian, [N, 11]: the inverse of `flat`."""
        return cls(flat[:, :3], flat[:, 3:6], flat[:, 6:10], flat[:, 10])
