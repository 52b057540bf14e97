"""The shape of a field, and how gradients of semantics may travel through it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

Routing = Literal["paper", "isolated", "coupled"]
ROUTINGS: tuple[Routing, ...] = ("paper", "isolated", "coupled")


@dataclass(frozen=True)
class FieldConfig:
    """Shape of a field; `channels`, `resolution`, `time_resolution` and `levels` are the HexPlane's.

    Routing `paper`: Ψ_geo and Ψ_sem both decode Z_kin and train it. `isolated`: Ψ_sem reads a detached Z_kin and small planes of its own.
    `coupled`: semantics are a function of the decoded geometry (the baseline).
    """

    routing: Routing = "isolated"
    rank: int = 0  # length of a semantic latent; 0 for a scene without semantics
    appearance: bool = True  # whether Ψ_app may change colour in time
    color_knots: int = 0  # times at which every Gaussian has a colour residual beside Ψ_app's: highlights are finer than any plane
    channels: int = 16
    resolution: int = 64
    time_resolution: int = 32
    levels: tuple[int, ...] = (1, 2)
    static: bool = False  # nothing moves, turns, resizes or fades: the canonical Gaussians are the scene at all times (a baseline)
    fixed_latents: bool = False  # latents belong to the canonical Gaussians and never change, as in baselines without Ψ_sem
    linear_states: bool = False  # whether Z_kin is a linear function of h_base (Eq. 1), not a rectified one

    def to_json(self) -> dict:
        return asdict(self) | {"levels": list(self.levels)}

    @classmethod
    def from_json(cls, values: dict) -> FieldConfig:
        return cls(**(values | {"levels": tuple(values["levels"])}))
