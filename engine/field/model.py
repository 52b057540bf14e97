"""The 4D scene: canonical Gaussians and the field that carries them through time (paper §2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from degense.engine.field import decode_cpu, networks_cpu
from degense.engine.field.branches import DEFORMATION, Branch, Deformation, Kinematics
from degense.engine.field.config import FieldConfig
from degense.engine.field.hexplane import HexPlane, at_time
from degense.engine.raster.limits import MIN_ALPHA
from degense.engine.splats import Splats

CANONICAL = ("means", "log_scales", "quats", "logits", "colors", "color_residuals", "semantics", "temporal_windows", "velocities")
FIXED = ("temporal_windows",)  # of these: as the initialisation has it, never learned (docs/decisions/0025)
MAX_AGE = 2.0  # of 1/ω: how long before and after its temporal centre a Gaussian keeps its linear velocity


@dataclass
class State:
    """The scene at one time, with what the regularisers need."""

    splats: Splats
    deformation: Deformation | None
    delta_color: Tensor | None  # of Ψ_app [N, 3]
    delta_semantics: Tensor | None  # Δf_sem [N, rank]
    means_at_other: Tensor | None = None  # centres [N, 3], or of the rows that were asked for, at the other time, if one was given


class SceneModel(nn.Module):
    """Canonical Gaussians, HexPlane, Z_kin and the decoding branches. Lengths are in the normalised unit (median depth 1).

    Parameters
    ----------
    bounds : float [2, 3]
        Lower and upper corner of the box that the planes cover; frozen.
    canonical : dict of Tensor
        `means` [N, 3], `log_scales` [N, 3], `quats` [N, 4], `logits` [N] (opacity), `colors` [N, 3], `semantics` [N, rank].
        `color_residuals` [N, color_knots, 3]: added to the colour, a spline over the knots. `temporal_windows` [N, 2]: centre τ and
        inverse scale ω of a Gaussian's temporal window, which are set at initialisation and not learned; ω = 0 is persistent.
        `velocities` [N, 3]: linear motion of a transient Gaussian in 1/ω, added to the deformation, within `MAX_AGE`/ω of τ.
        ValueError if a shape is another.
    """

    bounds: Tensor
    #: int64 [M]; the Gaussians that the field changes; the others never enter it. None: all. See `engine.field.static_gaussians`.
    moving: Tensor | None
    #: bool [N]; Gaussians that keep their place: their displacement is 0 at all times. None: none do. See `engine.field.static_gaussians`.
    still: Tensor | None
    #: float [N, 3, rank]; R_i: how much a Gaussian's latent changes with its colour, since tissue that chars or is bled over changes its
    #: class with its colour. Set by `engine.training.semantic.distillation`; None: not at all.
    semantic_coefficients: Tensor | None

    def __init__(self, config: FieldConfig, bounds: Tensor, canonical: dict[str, Tensor]):
        super().__init__()
        widths = {
            "means": (3,),
            "log_scales": (3,),
            "quats": (4,),
            "logits": (),
            "colors": (3,),
            "color_residuals": (config.color_knots, 3),
            "semantics": (config.rank,),
            "temporal_windows": (2,),
            "velocities": (3,),
        }
        expected = {name: (len(canonical["means"]), *widths[name]) for name in CANONICAL}
        if wrong := [name for name in CANONICAL if canonical[name].shape != expected[name]]:
            raise ValueError(f"{wrong[0]} is {list(canonical[wrong[0]].shape)}, not {list(expected[wrong[0]])}")
        if bounds.shape != (2, 3):
            raise ValueError(f"bounds is {list(bounds.shape)}, not [2, 3]")
        self.config = config
        self.register_buffer("bounds", bounds.float())
        self.register_buffer("moving", None)
        self.register_buffer("still", None)
        self.register_buffer("semantic_coefficients", None)
        self.canonical = nn.ParameterDict(
            {name: nn.Parameter(canonical[name].float().contiguous(), name not in FIXED) for name in CANONICAL}
        )
        self.planes = HexPlane(config.channels, config.resolution, config.time_resolution, config.levels)
        self.kinematics = Kinematics(self.planes.dimension, linear=config.linear_states)
        latent = self.kinematics.dimension
        self.geometry = Branch(latent, DEFORMATION)
        self.appearance = Branch(latent, 3) if config.appearance else None
        self.semantic_planes: HexPlane | None = None
        self.semantic: Branch | None = None
        changing = config.rank > 0 and not config.fixed_latents
        if changing and config.routing == "isolated":
            self.semantic_planes = HexPlane(8, config.resolution, config.time_resolution, config.levels)
            self.semantic = Branch(latent + self.semantic_planes.dimension, config.rank)
        elif changing and config.routing == "paper":
            self.semantic = Branch(latent, config.rank)
        elif changing:
            self.semantic = Branch(DEFORMATION + config.rank, config.rank)

    def __len__(self) -> int:
        return self.canonical["means"].shape[0]

    def set_moving(self, rows: Tensor) -> None:
        """Keep all Gaussians but `rows` (int64 [M], ascending) out of the field. ValueError for rows that there are none of."""
        if rows.ndim != 1 or rows.dtype != torch.int64 or (len(rows) and not (0 <= int(rows.min()) <= int(rows.max()) < len(self))):
            raise ValueError(f"moving must name rows of {len(self)} Gaussians")
        self.moving = rows.to(self.bounds.device)

    def set_still(self, still: Tensor) -> None:
        """Let the Gaussians that are `still`, bool [N], keep their place. ValueError for a mask that does not fit."""
        if still.dtype != torch.bool or still.shape != (len(self),):
            raise ValueError(f"still must be a mask of {len(self)} Gaussians")
        self.still = still.to(self.bounds.device)

    def set_semantic_coefficients(self, semantic_coefficients: Tensor) -> None:
        """Let latents follow colours. ValueError for a shape that does not fit."""
        if semantic_coefficients.shape != (len(self), 3, self.config.rank):
            raise ValueError(f"semantic coefficients are {list(semantic_coefficients.shape)}, not {[len(self), 3, self.config.rank]}")
        self.semantic_coefficients = semantic_coefficients.float().contiguous().to(self.bounds.device)

    def normalised(self, points: Tensor) -> Tensor:
        """Scene positions mapped so that `bounds` becomes [-1, 1]³."""
        low, high = self.bounds
        return (points - low) / (high - low) * 2.0 - 1.0

    def at(
        self,
        t: float | Tensor,
        *,
        deform: bool = True,
        semantics: bool = True,
        other: float | Tensor | None = None,
        rows: Tensor | None = None,
        present: Tensor | None = None,
    ) -> State:
        """The scene at time `t` ∈ [-1, 1], and with `other` the centres at a second time, of all or only of the `rows`, int64 [m].

        Only the Gaussians that are `present`, int64 [k], ascending, enter the field, where they are named; the others are not deformed.

        Times are tensors on the model's device where the call is recorded in a CUDA graph. Without `deform` it is the canonical Gaussians
        (the coarse stage); without `semantics` the splats carry no latents, and everything that only latents need is skipped.
        """
        latents = self.canonical["semantics"] if semantics else self.canonical["semantics"][:, :0]
        if not deform or self.config.static:
            means = None if other is None else self.means_at(other)
            return State(self._splats(t, None, None, latents), None, None, None, means if means is None or rows is None else means[rows])
        moving = self.moving if present is None else present
        places = self.normalised(self.canonical["means"].detach())
        points = places if moving is None else places.index_select(0, moving)
        means_at_other = None
        if other is None and self._is_fused():
            decoded, delta_color, change = self._decode_fused(points, t, semantics)
        else:
            asked = None if other is None else (places if rows is None else places.index_select(0, rows), other)
            decoded, decoded_at_other, delta_color, change = self._decode(points, t, asked, semantics)
            if other is not None and decoded_at_other is not None:
                placed = self.canonical["means"] + self.linear_motion(other)
                shift = self._shift(decoded_at_other[:, :3], rows)
                means_at_other = (placed if rows is None else placed.index_select(0, rows)) + shift
        deformation = Deformation.of(decoded)
        if semantics and self.semantic is not None and self.config.routing == "coupled":  # f_sem(t) = f_sem + C([ΔG_t, f_sem])
            change = self.semantic(torch.cat([deformation.flat, latents if moving is None else latents[moving]], 1))
        if moving is not None:
            deformation, delta_color, change = self._scatter(moving, deformation, delta_color, change)
        deformation = replace(deformation, means=self._shift(deformation.means))
        splats = self._splats(t, deformation, delta_color, latents if change is None else latents + change)
        return State(splats, deformation, delta_color, change, means_at_other)

    def means_at(self, t: float | Tensor) -> Tensor:
        """Only the centres [N, 3] at time `t`: what motion supervision and displacement layers need."""
        if self.config.static:
            return self.canonical["means"]
        points = self.normalised(self.canonical["means"].detach())
        if self._is_fused():
            [decoded] = decode_cpu.decode(points, t, self.planes, None, self.kinematics, [self.geometry.decode])
        elif self._is_on_cpu:
            [decoded] = networks_cpu.networks(self.planes(points, t), self.kinematics, [(self.geometry.decode, len(points))])
        else:
            decoded = self.geometry(self.kinematics(self.planes(points, t)))
        return self.canonical["means"] + self.linear_motion(t) + self._shift(decoded[:, :3])

    def _shift(self, decoded: Tensor, rows: Tensor | None = None) -> Tensor:
        """Displacements [N, 3], or of the `rows`, as they are decoded, but 0 for the Gaussians that are `still`."""
        if self.still is None:
            return decoded
        still = self.still if rows is None else self.still.index_select(0, rows)
        return decoded.masked_fill(still[:, None], 0.0)

    def present(self, t: float | Tensor) -> Tensor:
        """Rows, int64 [k], of the Gaussians whose temporal window lets them be drawn at a time."""
        return torch.nonzero(self._age(t).square() <= -2 * math.log(MIN_ALPHA))[:, 0]

    def linear_motion(self, t: float | Tensor) -> Tensor:
        """Displacement [N, 3] by each transient Gaussian's linear velocity since its temporal centre; 0 for persistent ones."""
        return self.canonical["velocities"] * self._age(t).clamp(-MAX_AGE, MAX_AGE)[:, None]

    def _age(self, t: float | Tensor) -> Tensor:
        """ω (t − τ) of every Gaussian [N]; always 0 for persistent ones."""
        center, inverse_scale = self.canonical["temporal_windows"].unbind(1)
        return inverse_scale * (t - center)

    @property
    def persistent(self) -> Tensor:
        """Which Gaussians are persistent, bool [N]."""
        return is_persistent(self.canonical["temporal_windows"])

    def _scatter(
        self, rows: Tensor, deformation: Deformation, delta_color: Tensor | None, change: Tensor | None
    ) -> tuple[Deformation, Tensor | None, Tensor | None]:
        """Changes of some Gaussians as rows among all; 0 for the others."""
        parts = [deformation.flat, *(part for part in (delta_color, change) if part is not None)]
        changes = torch.cat(parts, 1)
        all_rows = changes.new_zeros(len(self), changes.shape[1]).index_copy(0, rows, changes)
        flat, *rest = all_rows.split([part.shape[1] for part in parts], 1)
        scattered = iter(rest)
        return Deformation.of(flat), next(scattered) if delta_color is not None else None, next(scattered) if change is not None else None

    def _is_fused(self) -> bool:
        """Whether no gradient is wanted, and there is a fused way to decode: on the CPU, in float32."""
        learning = torch.is_grad_enabled() and any(parameter.requires_grad for parameter in self.parameters())
        return not learning and self._is_on_cpu

    @property
    def _is_on_cpu(self) -> bool:
        """Whether the fused networks of the CPU can be used, which are for float32."""
        return self.bounds.device.type == "cpu" and self.bounds.dtype == torch.float32

    def _decode_fused(self, points: Tensor, t: float | Tensor, semantics: bool) -> tuple[Tensor, Tensor | None, Tensor | None]:
        """`_decode` at one time, by the fused kernel."""
        semantic = self.semantic if semantics and self.config.routing != "coupled" else None
        branches = (self.geometry, self.appearance, semantic)
        semantic_planes = None if semantic is None else self.semantic_planes
        decoders = [branch.decode for branch in branches if branch is not None]
        outputs = iter(decode_cpu.decode(points, t, self.planes, semantic_planes, self.kinematics, decoders))
        return next(outputs), None if self.appearance is None else next(outputs), None if semantic is None else next(outputs)

    def _decode(
        self, points: Tensor, t: float | Tensor, other: tuple[Tensor, float | Tensor] | None, semantics: bool
    ) -> tuple[Tensor, Tensor | None, Tensor | None, Tensor | None]:
        """ΔG of points at `t` and of others at another time, Δcolour and Δf_sem as a function of Z_kin (Eq. 1, 2); None for what there is
        none of."""
        features = self.planes(points, t, *(() if other is None else (other,)))
        latent_branch = self.semantic if semantics and self.config.routing != "coupled" else None
        if latent_branch is None and self._is_on_cpu:
            asked = [(self.geometry.decode, len(features))]
            asked += [] if self.appearance is None else [(self.appearance.decode, len(points))]
            decoded, *colors = networks_cpu.networks(features, self.kinematics, asked)
            return decoded[: len(points)], None if other is None else decoded[len(points) :], colors[0] if colors else None, None
        kinematic = self.kinematics(features)
        decoded, decoded_at_other = self.geometry(kinematic), None
        if other is not None:
            kinematic, (decoded, decoded_at_other) = kinematic[: len(points)], decoded.tensor_split([len(points)])
        delta_color = self.appearance(kinematic) if self.appearance is not None else None
        change = None
        if latent_branch is not None:
            planes = self.semantic_planes
            change = latent_branch(kinematic if planes is None else torch.cat([kinematic.detach(), planes(points, t)], 1))
        return decoded, decoded_at_other, delta_color, change

    def _splats(self, t: float | Tensor, deformation: Deformation | None, delta_color: Tensor | None, latents: Tensor) -> Splats:
        c = self.canonical
        means, log_scales, quats, logits, colors = c["means"], c["log_scales"], c["quats"], c["logits"], c["colors"]
        if deformation is not None:
            means, log_scales = means + self.linear_motion(t) + deformation.means, log_scales + deformation.log_scales
            quats, logits = quats + deformation.quats, logits + deformation.opacities
            change = delta_color  # of Ψ_app plus each Gaussian's residual; None where colours do not change
            if self.config.color_knots:
                residual = at_time(c["color_residuals"], t)
                change = residual if change is None else change + residual
            if change is not None:
                colors = colors + change
                if self.semantic_coefficients is not None and latents.shape[1]:
                    for channel, coefficient in zip(change.detach().split(1, 1), self.semantic_coefficients.unbind(1), strict=True):
                        latents = torch.addcmul(latents, channel, coefficient)
        window = torch.exp(-0.5 * self._age(t).square())
        return Splats(means, quats, log_scales.exp(), logits.sigmoid() * window, colors, latents)


def is_persistent(temporal_windows: Tensor) -> Tensor:
    """Which of the temporal windows [N, 2] (centre, inverse scale) are of persistent Gaussians, bool [N]: an inverse scale of 0."""
    return temporal_windows[:, 1] == 0
