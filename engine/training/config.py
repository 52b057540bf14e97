"""What a training does, in numbers: one dataclass, its settings in groups, and three presets."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Literal, get_args

import torch

from degense.engine.errors import DegenseError
from degense.engine.field import ROUTINGS, Routing
from degense.engine.gpu import driver_fault, gpu_usable, lacking_kernels

CoarseFrames = Literal["first", "all"]


def setting(default: Any, words: str, group: str = "") -> Any:
    """A field of `TrainConfig`: its default, what it does, and the title of the group that begins with it."""
    return field(default=default, metadata={"words": words, "group": group})


@dataclass(frozen=True)
class TrainConfig:
    """Settings of one training. Lengths are in the normalised unit (median depth 1); learning rates are Adam's."""

    preset: str = setting("balanced", "The preset the values started from.", "The run")
    given: tuple[str, ...] = setting((), "Settings that were chosen by hand.")
    seed: int = setting(0, "Of everything that is drawn at random.")
    device: str = setting("auto", "What computes: auto, cpu or cuda; auto is the GPU where there is one.")
    max_pixels: int = setting(1 << 20, "Frames larger than this are trained on at a reduced size.")
    checkpoint_seconds: float = setting(30.0, "Seconds between checkpoints: what the end of the program by force can cost at most.")

    iterations: int = setting(3000, "All steps of the trainer.", "Schedule")
    coarse_iterations: int = setting(
        600,
        "How many of the iterations, fewer than all, draw static Gaussians, while the field learns from optical flow alone: without flow "
        "it does not change. Latents are static too, and learned where semantics are trained together with geometry. A preset's are fewer "
        "in proportion where the iterations are fewer than the preset's.",
    )
    coarse_frames: CoarseFrames = setting("first", "Which training frames the coarse iterations draw: first or all.")  # noqa: RUF009
    motion_iterations: int = setting(
        0, "In how many of the iterations the field learns, and with it all motion: more would fit noise with it. 0 is all."
    )
    semantic_every: int = setting(
        2, "A semantic pass every so many steps, where semantics are trained together with geometry (`paper`, `coupled`)."
    )
    semantic_steps: int = setting(600, "Steps of semantic distillation after geometry is finished (`isolated`).")

    max_gaussians: int = setting(60_000, "Cap on the number of Gaussians.", "Gaussians")
    densify_every: int = setting(200, "Densify and prune every so many steps.")
    densify_until: float = setting(0.6, "Share of the iterations after which nothing is densified or pruned.")
    velocities: bool = setting(True, "Whether transient Gaussians, such as those of instruments, have a linear velocity of their own.")
    persistent: bool = setting(False, "Whether every Gaussian exists at all times; transient ones of the initialisation are left out.")

    static: bool = setting(False, "Nothing moves. For baselines (`engine.research.systems`).", "Field")
    appearance: bool = setting(True, "Whether colour may change in time.")
    color_spacing: float = setting(3.0, "Frames between the knots of the per-Gaussian colour residuals.")
    channels: int = setting(16, "Channels of the HexPlane.")
    resolution: int = setting(64, "Cells of the HexPlane along each axis of space, at its coarsest level.")
    levels: tuple[int, ...] = setting((1, 2), "Levels of the HexPlane: factors of its resolution.")
    time_resolution: int = setting(0, "Cells of the HexPlane along time; 0 is half the number of frames.")
    linear_states: bool = setting(False, "Whether the states φ_k of Z_kin are linear (Eq. 1) instead of rectified.")

    routing: Routing = setting(  # noqa: RUF009
        "isolated",
        "How gradients of the semantic loss may travel: paper, isolated or coupled (see `engine.field.FieldConfig`).",
        "Semantics",
    )
    angular: bool = setting(True, "True: L_align = E[1 − ⟨ṽ_pred, ṽ_gt⟩] (Eq. 3). False: L1 on the latents, as the coupled peers do.")
    lift: bool = setting(
        True, "Whether semantic distillation starts from the mean of all targets back-projected to a Gaussian, instead of from nothing."
    )
    guided: bool = setting(True, "Whether the vectors of a coarse teacher are upsampled along the superpixels of the frames.")
    consensus: bool = setting(
        True,
        "Whether targets are what all frames of the teacher agree on (`engine.training.semantic.consensus`), instead of its answer in "
        "each; not where it labels few frames.",
    )
    rarity: bool = setting(True, "Whether labelled pixels weigh more where their class is rare; else L_align is their plain mean.")
    max_rank: int = setting(32, "Most dimensions of the latents.")
    fixed_latents: bool = setting(False, "Latents never change in time. For baselines.")
    distillation: str = setting(
        "gaussians",
        "What fits semantics to a finished geometry (`isolated`): gaussians, or what an experiment added to "
        "`engine.training.semantic.distillation.DISTILLATIONS`.",
    )

    ssim: float = setting(0.2, "Weight of 1 − SSIM; L1 has the rest.", "Weights of the losses on frames and flow")
    depth: float = setting(0.5, "Weight of the error of 1/z, where depth was measured.")
    flow: float = setting(
        20.0, "Weight of the distance between each visible Gaussian's motion and the optical flow, in units of the scene."
    )
    photometric_precision: bool = setting(
        True,
        "Whether colour teaches displacements only as far as texture stands out from noise, where there is flow to teach them. Trainings "
        "of a few hundred steps need its help to find them.",
    )
    flow_constancy: bool = setting(
        True,
        "Whether flow is dropped where tissue changes its look, since it takes a change of colour for motion (`engine.motion.constancy`).",
    )
    flow_precision: bool = setting(True, "Whether flow counts less where noise makes it uncertain on the texture that is there.")
    depth_precision: bool = setting(
        True, "Whether measured depth counts less the more it errs from frame to frame (`engine.motion.depth_noise`); needs flow."
    )
    depth_together: bool = setting(
        True,
        "Whether the depth of all frames together tells how tissue comes and goes, where that of single frames errs "
        "(`engine.training.flow.along_sight`); needs flow.",
    )
    stillness: bool = setting(
        True, "Whether tissue that flow cannot tell from standing still keeps its place (`engine.field.static_gaussians`); needs flow."
    )
    flow_inference: bool = setting(
        True,
        "Whether tissue that changes its look moves by the share of the motion around it that it had before "
        "(`engine.training.flow.inferred`).",
    )

    displacement: float = setting(0.01, "Weight of |Δμ|, the size of displacements.", "Weights of the regularizers")
    rigidity: float = setting(4.0, "Weight of the difference of Δμ between neighbours.")
    shape: float = setting(0.002, "Weight of Δ log-scale, Δ quaternion and Δ opacity.")
    delta_color: float = setting(0.001, "Weight of |Δcolour| of Ψ_app.")
    color_residual: float = setting(0.002, "Weight of the per-Gaussian colour residuals, |Δcolour|.")
    color_residual_change: float = setting(0.02, "Weight of the squared change of colour residuals from knot to knot.")
    plane_space: float = setting(1e-3, "Weight of the planes' total variation.")
    plane_time: float = setting(1e-1, "Weight of the planes' acceleration in time.")
    plane_static: float = setting(1e-4, "Weight of the distance of the time planes from 1.")

    semantic: float = setting(0.5, "Weight of the whole semantic loss.", "Weights of the semantic losses")
    region: float = setting(0.02, "Weight of L_smooth within the semantic loss.")
    delta_semantics: float = setting(0.01, "Weight of |Δf_sem| within the semantic loss.")

    rate_means: float = setting(1.6e-4, "Learning rate of the Gaussians' centres.", "Learning rates")
    rate_scales: float = setting(5e-3, "Learning rate of the Gaussians' log-scales.")
    rate_quats: float = setting(1e-3, "Learning rate of the Gaussians' quaternions.")
    rate_opacity: float = setting(2e-2, "Learning rate of the Gaussians' opacities.")
    rate_color: float = setting(2.5e-3, "Learning rate of the Gaussians' colours.")
    rate_color_residuals: float = setting(2.5e-3, "Learning rate of the Gaussians' colour residuals.")
    rate_semantics: float = setting(1e-2, "Learning rate of the Gaussians' latents.")
    rate_planes: float = setting(2e-2, "Learning rate of the HexPlane.")
    rate_field: float = setting(1.6e-3, "Learning rate of the networks.")
    rate_final: float = setting(0.05, "Factor by which the rates of positions and field have fallen at the end; in the cool-down all fall.")

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
        if config.motion_iterations < 0:
            raise DegenseError("motion_iterations must not be negative; 0 is all of the iterations")
        if config.resolution < 2:
            raise DegenseError("resolution must be at least 2: a cell lies between two values")
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

    @property
    def motion_share(self) -> float:
        """Share of the training in which the field learns."""
        return min(1.0, self.motion_iterations / self.iterations) if self.motion_iterations else 1.0

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
        "photometric_precision": False,
    },
    "balanced": {"iterations": 3000, "coarse_iterations": 600, "max_gaussians": 60_000},
    "best": {"iterations": 10_000, "coarse_iterations": 600, "motion_iterations": 3000, "color_residual_change": 0.1},
}


def _groups() -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for item in fields(TrainConfig):
        title = item.metadata["group"] or [*found][-1]
        found[title] = (*found.get(title, ()), item.name)
    return found


#: The settings by group, in the order of the fields.
GROUPS = _groups()


def choose_device(name: str) -> torch.device:
    """`auto` takes a GPU when there is one that can be used. DegenseError when `cuda` is asked for and cannot."""
    if name not in ("auto", "cpu", "cuda"):
        raise DegenseError(f"there is no device {name!r}; choose auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise DegenseError("no CUDA GPU was found; train with --device cpu, or see degense doctor")
    if name == "cuda" and (sentence := lacking_kernels() or driver_fault()):
        raise DegenseError(sentence)
    return torch.device("cuda" if name == "cuda" or (name == "auto" and gpu_usable()) else "cpu")
