"""What a training does, in numbers: one dataclass, three presets."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace

from degense.engine.errors import DegenseError
from degense.engine.field import ROUTINGS, Routing


@dataclass(frozen=True)
class TrainConfig:
    """Settings of one training. Lengths are in the normalised unit (median depth 1); learning rates are Adam's.

    Attributes
    ----------
    preset : str
        The preset the values started from.
    routing : {"paper", "isolated", "coupled"}
        How gradients of the semantic loss may travel (see `engine.field.FieldConfig`).
    angular : bool
        True: L_align = E[1 − ⟨ṽ_pred, ṽ_gt⟩] (Eq. 3). False: L1 on the latents, as the coupled peers do.
    iterations, coarse_iterations : int
        All steps, and how many of them draw the first training frame only, from Gaussians that stand still, while the field learns to
        move them from the evidence of motion.
    max_gaussians : int
        Cap on the number of Gaussians.
    max_pixels : int
        Frames larger than this are trained on at a reduced size.
    seed : int
        Of everything that is drawn at random.
    device : {"auto", "cpu", "cuda"}
        What computes; "auto" is the GPU where there is one.
    ssim, depth, semantic, region : float
        Weights of 1 − SSIM, |1/z| error (measured depth only), semantic loss and L_smooth.
    semantic_every : int
        A semantic pass every so many steps, where meaning is trained together with geometry (`paper`, `coupled`).
    semantic_steps : int
        Steps that refine meaning after geometry is finished (`isolated`; see `engine.training.semantic.distillation`).
    lift : bool
        Whether these start from the mean of all that the teacher says about a Gaussian, instead of from nothing.
    guided : bool
        Whether the vectors of a coarse teacher are shared out over superpixels of the frames.
    max_rank : int
        Most dimensions of the latents.
    plane_space, plane_time, plane_still : float
        Weights of the planes' total variation, acceleration in time, and distance of the time planes from 1.
    displacement, rigidity, shape : float
        Weights of |Δμ|, of the difference of Δμ between neighbours, and of Δ log-scale, Δ quaternion and Δ opacity.
    delta_color, delta_semantics : float
        Weights of |Δcolour| of Ψ_app and of |Δf_sem|.
    tint, color_residual_change : float
        Weights of |Δcolour| that a Gaussian has of its own, and of its squared change from knot to knot.
    flow : float
        Weight of motion evidence: how far each visible Gaussian's motion is from the optical flow, in units of the scene.
    appearance : bool
        Whether colour may change in time.
    color_spacing : float
        Frames between the knots of a Gaussian's own colour changes.
    channels, resolution, levels, time_resolution
        Of the HexPlane; a time resolution of 0 is half the number of frames.
    rate_means, rate_field, rate_planes, rate_scales, rate_quats, rate_opacity, rate_color, rate_color_residuals : float
    rate_semantics, rate_final : float
        Learning rates, and the factor by which those of positions and field have fallen at the end; then all fall (`set_rates`).
    densify_every, densify_until : int, float
        Densify and prune every so many steps, until this share of the iterations.
    early_stop : bool
        Watch a few training frames of a long clip, and cool down as soon as they stop improving (`engine.training.fitting.early_stopping`).
    static, fixed_latents : bool
        Of the field: whether nothing moves, and whether latents never change. For baselines (`engine.research.systems`).
    velocities : bool
        Whether what exists for a while may go straight on by itself, as instruments do.
    persistent : bool
        Whether every Gaussian exists for ever; those that the initialisation would let live for a few frames are left out.
    codebook : bool
        Whether meaning belongs to clusters of Gaussians (`engine.training.semantic.codebook`) instead of single ones.
    checkpoint_seconds : float
        Seconds between checkpoints: what the end of the program by force can cost at most.
    fit : bool
        Whether settings may become smaller where the clip needs less (`engine.training.fitting.budget`).
    given : tuple of str
        Settings that were chosen by hand, which fitting leaves alone.
    """

    preset: str = "balanced"
    routing: Routing = "isolated"
    angular: bool = True
    iterations: int = 3000
    coarse_iterations: int = 600
    max_gaussians: int = 60_000
    max_pixels: int = 1 << 20
    seed: int = 0
    device: str = "auto"
    ssim: float = 0.2
    depth: float = 0.5
    semantic: float = 0.5
    region: float = 0.02
    semantic_every: int = 2
    semantic_steps: int = 600
    lift: bool = True
    guided: bool = True
    max_rank: int = 32
    plane_space: float = 1e-3
    plane_time: float = 1e-1
    plane_still: float = 1e-4
    displacement: float = 0.002
    rigidity: float = 0.1
    shape: float = 0.002
    delta_color: float = 0.001
    delta_semantics: float = 0.01
    color_residual: float = 0.002
    color_residual_change: float = 0.02
    flow: float = 40.0
    appearance: bool = True
    color_spacing: float = 3.0
    channels: int = 16
    resolution: int = 64
    levels: tuple[int, ...] = (1, 2)
    time_resolution: int = 0
    rate_means: float = 1.6e-4
    rate_field: float = 1.6e-3
    rate_planes: float = 2e-2
    rate_scales: float = 5e-3
    rate_quats: float = 1e-3
    rate_opacity: float = 2e-2
    rate_color: float = 2.5e-3
    rate_color_residuals: float = 2.5e-3
    rate_semantics: float = 1e-2
    rate_final: float = 0.05
    densify_every: int = 200
    densify_until: float = 0.6
    early_stop: bool = False
    static: bool = False
    fixed_latents: bool = False
    velocities: bool = True
    persistent: bool = False
    codebook: bool = False
    checkpoint_seconds: float = 30.0
    fit: bool = True
    given: tuple[str, ...] = ()

    @classmethod
    def preset_of(cls, name: str, **overrides) -> TrainConfig:
        """The preset `name` with `overrides` that are not None applied. Raises DegenseError for an unknown preset or routing."""
        if name not in PRESETS:
            raise DegenseError(f"there is no preset {name!r}; choose one of {', '.join(PRESETS)}")
        chosen = {key: value for key, value in overrides.items() if value is not None}
        config = replace(cls(preset=name, **PRESETS[name]), **chosen, given=tuple(sorted(chosen)))
        if config.routing not in ROUTINGS:
            raise DegenseError(f"there is no routing {config.routing!r}; choose one of {', '.join(ROUTINGS)}")
        if config.iterations < 1 or config.max_gaussians < 16:
            raise DegenseError("a training needs at least 1 iteration and 16 Gaussians")
        if config.routing == "coupled":  # the baseline distils with L1, as its model does
            config = replace(config, angular=overrides.get("angular", False))
        return replace(config, coarse_iterations=min(config.coarse_iterations, config.iterations // 5))

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
    "best": {"iterations": 10_000, "coarse_iterations": 1000, "early_stop": True, "color_residual_change": 0.1},
}
