"""What a training does, in numbers: one dataclass, its settings in groups, and three presets."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import Literal, get_args

import torch

from degense.engine.errors import DegenseError
from degense.engine.field import ROUTINGS, Routing

CoarseFrames = Literal["first", "all"]


@dataclass(frozen=True)
class TrainConfig:
    """Settings of one training. Lengths are in the normalised unit (median depth 1); learning rates are Adam's.

    Attributes
    ----------
    preset : str
        The preset the values started from.
    given : tuple of str
        Settings that were chosen by hand.
    seed : int
        Of everything that is drawn at random.
    device : {"auto", "cpu", "cuda"}
        What computes; "auto" is the GPU where there is one.
    max_pixels : int
        Frames larger than this are trained on at a reduced size.
    checkpoint_seconds : float
        Seconds between checkpoints: what the end of the program by force can cost at most.
    iterations : int
        All steps of the trainer.
    coarse_iterations : int
        How many of them, fewer than all, draw static Gaussians, while the field learns from optical flow alone: without flow it does not
        change. Latents are static too, and learned where semantics are trained together with geometry. A preset's are fewer in proportion
        where the iterations are fewer than the preset's.
    coarse_frames : {"first", "all"}
        Which training frames they draw.
    semantic_every : int
        A semantic pass every so many steps, where semantics are trained together with geometry (`paper`, `coupled`).
    semantic_steps : int
        Steps of semantic distillation after geometry is finished (`isolated`; see `engine.training.semantic.distillation`).
    max_gaussians : int
        Cap on the number of Gaussians.
    densify_every, densify_until : int, float
        Densify and prune every so many steps, until this share of the iterations.
    velocities : bool
        Whether transient Gaussians, such as those of instruments, have a linear velocity of their own.
    persistent : bool
        Whether every Gaussian exists at all times; transient ones of the initialisation are left out.
    static : bool
        Nothing moves. For baselines (`engine.research.systems`).
    appearance : bool
        Whether colour may change in time.
    color_spacing : float
        Frames between the knots of the per-Gaussian colour residuals.
    channels, resolution, levels, time_resolution
        Of the HexPlane; a time resolution of 0 is half the number of frames.
    linear_states : bool
        Whether the states φ_k of Z_kin are linear (Eq. 1) instead of rectified.
    routing : {"paper", "isolated", "coupled"}
        How gradients of the semantic loss may travel (see `engine.field.FieldConfig`).
    angular : bool
        True: L_align = E[1 − ⟨ṽ_pred, ṽ_gt⟩] (Eq. 3). False: L1 on the latents, as the coupled peers do.
    lift : bool
        Whether semantic distillation starts from the mean of all targets back-projected to a Gaussian, instead of from nothing.
    guided : bool
        Whether the vectors of a coarse teacher are upsampled along the superpixels of the frames.
    rarity : bool
        Whether labelled pixels weigh more where their class is rare; else L_align is their plain mean.
    max_rank : int
        Most dimensions of the latents.
    fixed_latents : bool
        Latents never change in time. For baselines.
    distillation : str
        What fits semantics to a finished geometry (`isolated`): "gaussians", or what an experiment added to
        `engine.training.semantic.distillation.DISTILLATIONS`.
    ssim, depth : float
        Weights of 1 − SSIM (L1 has the rest) and of |1/z| error, where depth was measured.
    flow : float
        Weight of the distance between each visible Gaussian's motion and the optical flow, in units of the scene.
    flow_constancy : bool
        Whether flow is dropped where tissue changes its look, since it takes a change of colour for motion (`engine.motion.constancy`).
    flow_precision : bool
        Whether flow counts less where noise makes it uncertain on the texture that is there.
    displacement, rigidity, shape : float
        Weights of |Δμ|, of the difference of Δμ between neighbours, and of Δ log-scale, Δ quaternion and Δ opacity.
    delta_color : float
        Weight of |Δcolour| of Ψ_app.
    color_residual, color_residual_change : float
        Weights of the per-Gaussian colour residuals, |Δcolour|, and of their squared change from knot to knot.
    plane_space, plane_time, plane_static : float
        Weights of the planes' total variation, acceleration in time, and distance of the time planes from 1.
    semantic : float
        Weight of the whole semantic loss.
    region : float
        Weight of L_smooth within it.
    delta_semantics : float
        Weight of |Δf_sem| within it.
    rate_means, rate_scales, rate_quats, rate_opacity, rate_color, rate_color_residuals, rate_semantics : float
        Learning rates of the canonical Gaussians.
    rate_planes, rate_field : float
        Learning rates of the HexPlane and of the networks.
    rate_final : float
        Factor by which the rates of positions and field have fallen at the end; in the cool-down all fall (`set_rates`).
    """

    # The run
    preset: str = "balanced"
    given: tuple[str, ...] = ()
    seed: int = 0
    device: str = "auto"
    max_pixels: int = 1 << 20
    checkpoint_seconds: float = 30.0

    # Schedule
    iterations: int = 3000
    coarse_iterations: int = 600
    coarse_frames: CoarseFrames = "first"
    semantic_every: int = 2
    semantic_steps: int = 600

    # Gaussians
    max_gaussians: int = 60_000
    densify_every: int = 200
    densify_until: float = 0.6
    velocities: bool = True
    persistent: bool = False

    # Field
    static: bool = False
    appearance: bool = True
    color_spacing: float = 3.0
    channels: int = 16
    resolution: int = 64
    levels: tuple[int, ...] = (1, 2)
    time_resolution: int = 0
    linear_states: bool = False

    # Semantics
    routing: Routing = "isolated"
    angular: bool = True
    lift: bool = True
    guided: bool = True
    rarity: bool = True
    max_rank: int = 32
    fixed_latents: bool = False
    distillation: str = "gaussians"

    # Weights of the losses on frames and flow
    ssim: float = 0.2
    depth: float = 0.5
    flow: float = 20.0
    flow_constancy: bool = True
    flow_precision: bool = True

    # Weights of the regularizers
    displacement: float = 0.01
    rigidity: float = 1.0
    shape: float = 0.002
    delta_color: float = 0.001
    color_residual: float = 0.002
    color_residual_change: float = 0.02
    plane_space: float = 1e-3
    plane_time: float = 1e-1
    plane_static: float = 1e-4

    # Weights of the semantic losses
    semantic: float = 0.5
    region: float = 0.02
    delta_semantics: float = 0.01

    # Learning rates
    rate_means: float = 1.6e-4
    rate_scales: float = 5e-3
    rate_quats: float = 1e-3
    rate_opacity: float = 2e-2
    rate_color: float = 2.5e-3
    rate_color_residuals: float = 2.5e-3
    rate_semantics: float = 1e-2
    rate_planes: float = 2e-2
    rate_field: float = 1.6e-3
    rate_final: float = 0.05

    @classmethod
    def preset_of(cls, name: str, **overrides) -> TrainConfig:
        """The preset `name` with `overrides` that are not None applied.

        Raises
        ------
        DegenseError
            For an unknown preset or routing, or settings that exclude each other.
        """
        if name not in PRESETS:
            raise DegenseError(f"there is no preset {name!r}; choose one of {', '.join(PRESETS)}")
        chosen = {key: value for key, value in overrides.items() if value is not None}
        config = replace(cls(preset=name, **PRESETS[name]), **chosen, given=tuple(sorted(chosen)))
        if config.routing not in ROUTINGS:
            raise DegenseError(f"there is no routing {config.routing!r}; choose one of {', '.join(ROUTINGS)}")
        if config.coarse_frames not in get_args(CoarseFrames):
            raise DegenseError(f"coarse_frames is first or all, not {config.coarse_frames!r}")
        if config.iterations < 1 or config.max_gaussians < 16:
            raise DegenseError("a training needs at least 1 iteration and 16 Gaussians")
        if config.routing == "coupled":  # the baseline distils with L1, as its model does
            config = replace(config, angular=overrides.get("angular", False))
        if "coarse_iterations" not in chosen:
            usual = PRESETS[name]["iterations"]
            return replace(config, coarse_iterations=config.coarse_iterations * min(config.iterations, usual) // usual)
        if config.coarse_iterations >= config.iterations:
            raise DegenseError(f"coarse_iterations must be less than the iterations: {config.coarse_iterations:,} of {config.iterations:,}")
        return config

    def to_json(self) -> dict:
        return asdict(self) | {"levels": list(self.levels), "given": list(self.given)}

    @classmethod
    def from_json(cls, values: dict) -> TrainConfig:
        known = {f.name for f in fields(cls)}
        if unknown := set(values) - known:
            raise DegenseError(f"the run's configuration has unknown settings: {', '.join(sorted(unknown))}")
        return cls(**(values | {"levels": tuple(values["levels"]), "given": tuple(values.get("given", ()))}))


PRESETS: dict[str, dict] = {
    "quick": {
        "iterations": 800,
        "coarse_iterations": 160,
        "max_gaussians": 12_000,
        "max_pixels": 120_000,
        "resolution": 48,
        "semantic_every": 3,
        "densify_every": 100,
        "semantic_steps": 400,
    },
    "balanced": {"iterations": 3000, "coarse_iterations": 600, "max_gaussians": 60_000},
    "best": {"iterations": 10_000, "coarse_iterations": 1000, "color_residual_change": 0.1},
}

#: Which settings belong together: the name of a group and its first setting; a group ends where the next begins.
_FIRST = {
    "The run": "preset",
    "Schedule": "iterations",
    "Gaussians": "max_gaussians",
    "Field": "static",
    "Semantics": "routing",
    "Weights of the losses on frames and flow": "ssim",
    "Weights of the regularizers": "displacement",
    "Weights of the semantic losses": "semantic",
    "Learning rates": "rate_means",
}


def _groups() -> dict[str, tuple[str, ...]]:
    names = [item.name for item in fields(TrainConfig)]
    starts = [names.index(first) for first in _FIRST.values()]
    return {title: tuple(names[a:b]) for title, a, b in zip(_FIRST, starts, [*starts[1:], None], strict=True)}


#: The settings by group, in the order of the fields.
GROUPS = _groups()


def choose_device(name: str) -> torch.device:
    """`auto` takes a GPU when there is one. DegenseError when `cuda` is asked for and absent."""
    if name not in ("auto", "cpu", "cuda"):
        raise DegenseError(f"there is no device {name!r}; choose auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise DegenseError("no CUDA GPU was found; train with --device cpu, or see degense doctor")
    return torch.device("cuda" if name == "cuda" or (name == "auto" and torch.cuda.is_available()) else "cpu")
