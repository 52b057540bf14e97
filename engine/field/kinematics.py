"""From a HexPlane feature to the latent kinematic descriptor Z_kin (paper Eq. 1)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

PROPERTIES = ("pos", "scale", "rot", "opa")


class Kinematics(nn.Module):
    """h_base = base(h_st);  Z_kin = ⊕_k φ_k(h_base), k ∈ {pos, scale, rot, opa}, φ_k linear (Eq. 1).

    Parameters
    ----------
    feature : int
        Length of h_st.
    width : int
        Length of h_base.
    state : int
        Length of each φ_k(h_base); Z_kin has 4 × `state` numbers.
    """

    def __init__(self, feature: int, width: int = 64, state: int = 16):
        super().__init__()
        self.base = nn.Sequential(nn.Linear(feature, width), nn.ReLU(inplace=True), nn.Linear(width, width), nn.ReLU(inplace=True))
        # The four maps share their input: one matrix holds them as blocks of rows, in the order of PROPERTIES.
        self.states = nn.Linear(width, state * len(PROPERTIES))
        for layer in (*self.base, self.states):
            if isinstance(layer, nn.Linear):
                nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu")

    @property
    def dimension(self) -> int:
        return self.states.out_features

    def forward(self, feature: Tensor) -> Tensor:
        """Z_kin [N, 4 × state] of h_st [N, feature]."""
        return torch.relu_(self.states(self.base(feature)))
