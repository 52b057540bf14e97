"""The systems that the paper compares, as settings of one training.

All share what is not in question: the field (HexPlane, Z_kin, Ψ_geo), the rasterizer, the first Gaussians from the clip's depth,
densification, Adam and its rates, and the teacher with its basis and its weights of rare classes. None of the peers' own autoencoders
(512 → 3 dimensions), segmenters (SAM) or vision-language models is here: all systems are trained on the same text vectors, in a
basis that keeps their angles. The peers' regularizers of renders (total variation) are left out, and none of ours on motion is put in
their place. Their semantic loss, a mean over 3 channels with weight 1, is a sum over some 8 channels with weight 0.2 here, which is as
large. Those that train everything together take it in every second or third step, as the preset has it: in every step their masks and
renders are worse.

`degensegs` is the paper's own system as its text has it, and so shares less: rates, targets without weights and steps are the paper's.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from degense.engine.errors import DegenseError
from degense.engine.training.config import TrainConfig


def degense(config: TrainConfig) -> TrainConfig:
    """DeGense, this program with its defaults.

    Motion is learned first, from optical flow; Ψ_app explains changes of colour; semantics come after geometry, back-projected from all
    frames and refined with the angular loss by a branch of its own, from which no gradient reaches geometry.
    """
    return config


def degensegs(config: TrainConfig) -> TrainConfig:
    """DeGenseGS, the paper's own system: as its text has it, where the text says.

    Kept: Z_kin of four linear projections of h_base (Eq. 1), from which Ψ_geo and Ψ_sem decode independently and which both train (Eq. 2);
    L_align as the plain mean of 1 − cos over labelled pixels (Eq. 3), and L_smooth over superpixels, in every step together with colour;
    the teacher's patches as they are. Deformation is frozen at first, for as many steps as the budget has (3,000 with `balanced`), while
    the canonical Gaussians learn colours and latents from all training frames; as many steps of everything follow, twice the budget in all.
    Adam with an initial rate of 1.6e-3 for HexPlane and networks; densification and pruning every 100 steps. Masks are those of the decoder
    `rnse-paper` (Eq. 4, guided filter, threshold).
    Chosen here, since the text does not say: L1 with 0.2 of D-SSIM on colour; the rates of 3DGS for canonical Gaussians, that of colours
    for their latents; this program's weights of L_sem and L_smooth; the first Gaussians, density control without opacity resets, falling
    rates and the compression of text vectors, which all systems here share. Latents are learned while the deformation is frozen, for the
    text freezes nothing else; Δf_sem, which is decoded from the frozen field, stands still with it.
    Without, for the text has none of them: optical flow, Ψ_app and colour residuals, temporal windows and velocities, back-projection and
    latents that follow colour, consensus over time, weights of rare classes, guided upsampling, a loss on depth, and any regularizer
    of motion or of planes.
    Not kept: CAT-Seg as the teacher; the size of planes and networks is this program's, for the text gives none.
    """
    paper: dict[str, Any] = {
        "routing": "paper",
        "linear_states": True,
        "fixed_latents": False,
        "angular": True,
        "rarity": False,
        "semantic": TrainConfig.semantic,
        "region": TrainConfig.region,
        "semantic_every": 1,
        "iterations": 2 * config.iterations,
        "coarse_iterations": config.iterations,
        "coarse_frames": "all",
        "densify_every": 100,
        "velocities": False,
        "depth": 0.0,
        "plane_space": 0.0,
        "plane_time": 0.0,
        "plane_static": 0.0,
        "rate_planes": 1.6e-3,
        "rate_field": 1.6e-3,
        "rate_opacity": 5e-2,
        "rate_semantics": TrainConfig.rate_color,
    }
    return replace(_peer(config), **paper)


def surgtpgs(config: TrainConfig) -> TrainConfig:
    """SurgTPGS (Huang et al., MICCAI 2025): semantics rigidly coupled to deformation.

    Kept: the latent is a function of the canonical latent and of the decoded deformation, f(t) = f + C([ΔG_t, f]); one loss trains
    everything from the first step, nothing is detached, so L_sem moves, turns, resizes and fades Gaussians; L1 on colour, on 1/depth and
    on latents, the smoothness within regions at a hundredth; the teacher's patches as they are; no optical flow, no stage of its own for
    motion or for the first frame, no change of colour.
    Not kept: motion as sums of Gaussian curves a Gaussian (here the shared field, with its smooth planes); C sees the whole deformation,
    not the change of scale alone; CAT-Seg's CLIP on SAM's masks as the teacher.
    """
    return replace(_peer(config), routing="coupled", fixed_latents=False, coarse_iterations=0, ssim=0.0, depth=1.0, region=0.01)


def langsplat(config: TrainConfig) -> TrainConfig:
    """LangSplat (Qin et al., CVPR 2024): a static scene with distilled features.

    Kept: nothing moves, fades or changes colour in time; colour first (L1 and D-SSIM, no depth loss), then as many steps for the features
    alone, with L1, on geometry that stands; features belong to the Gaussians.
    Not kept: three levels of SAM masks with a feature map each (here the one level that the teacher speaks on); spherical harmonics.
    """
    return _afterwards(replace(_peer(config), static=True, coarse_iterations=0, depth=0.0))


def opengaussian(config: TrainConfig) -> TrainConfig:
    """OpenGaussian (Wu et al., NeurIPS 2024): semantics by clusters of points.

    Kept: a static scene; six instance features a Gaussian, alike within segments of the pictures and unlike between them; a codebook of two
    levels, 64 clusters by feature and place with 5 by feature in each; text vectors belong to clusters and are not trained.
    Not kept: SAM's masks (segments are the teacher's own where it draws borders, else large superpixels); the training through quantised
    features (k-means of the finished ones instead); clusters get the mean of what the teacher says where they are seen, instead of the
    masks that overlap them best; a prompt is compared with the drawn mixture of cluster vectors in each pixel, instead of choosing
    clusters before drawing them.
    """
    return replace(langsplat(config), distillation="clusters")


def dgd(config: TrainConfig) -> TrainConfig:
    """DGD (Labe et al., ECCV 2024): a deforming scene whose features are fixed to the canonical Gaussians.

    Kept: Gaussians move, their features never change; colour first (L1 and D-SSIM, no depth loss), then a phase for semantics with L1, in
    which the deformation is frozen.
    Not kept: an MLP as the deformation (here the shared field); that the canonical Gaussians still follow both losses in the second phase
    (here only features learn, which spares the pictures); DINO or LSeg features of 384 and more dimensions.
    """
    return _afterwards(replace(_peer(config), coarse_iterations=0, depth=0.0))


def fe4dgs(config: TrainConfig) -> TrainConfig:
    """FE-4DGS (Feature-EndoGaussian, Li et al. 2025): static features in a 4D scene.

    Kept: a first stage on the first frame without deformation, then all frames; L1 on colour and on 1/depth; features that never change in
    time, trained together with the geometry by L1, nothing detached.
    Not kept: 128 features a Gaussian that a convolution turns into SAM's 256 (here the basis of the teacher's vectors); HexPlanes
    of four resolutions and 64 channels.
    """
    return replace(_peer(config), routing="paper", ssim=0.0, depth=1.0)


#: In the order of the paper's table, ours last.
SYSTEMS: dict[str, Callable[[TrainConfig], TrainConfig]] = {
    "langsplat": langsplat,
    "opengaussian": opengaussian,
    "dgd": dgd,
    "fe4dgs": fe4dgs,
    "surgtpgs": surgtpgs,
    "degensegs": degensegs,
    "degense": degense,
}


def as_system(name: str, config: TrainConfig) -> TrainConfig:
    """The settings with which a system trains, on the budget of `config`. DegenseError for an unknown system."""
    if name not in SYSTEMS:
        raise DegenseError(f"there is no system {name!r}; choose from {', '.join(SYSTEMS)}")
    return SYSTEMS[name](config)


def training_of(name: str, config: TrainConfig) -> TrainConfig:
    """`as_system` for one training. DegenseError where the system sets what was given by hand to something else."""
    found = as_system(name, config)
    for setting in config.given:
        if setting != "iterations" and (value := getattr(found, setting)) != getattr(config, setting):
            raise DegenseError(f"the system {name} is trained with {setting} {value}; leave {setting} out, or the system")
    return found


def words_of(name: str) -> str:
    """What a system is: what is kept of the original, and what is not."""
    return inspect.getdoc(SYSTEMS[name]) or ""


def _peer(config: TrainConfig) -> TrainConfig:
    """Without what no peer has: flow supervision, regularizers of motion, appearance, temporal windows, angular loss, back-projection."""
    without: dict[str, Any] = {
        "motion_iterations": 0,
        "flow": 0.0,
        "displacement": 0.0,
        "rigidity": 0.0,
        "shape": 0.0,
        "appearance": False,
        "persistent": True,
        "angular": False,
        "semantic": 0.2,
        "delta_semantics": 0.0,
        "region": 0.0,
        "guided": False,
        "consensus": False,
        "lift": False,
        "fixed_latents": True,
    }
    return replace(config, **without)


def _afterwards(config: TrainConfig) -> TrainConfig:
    """Semantics after geometry, with as many steps."""
    return replace(config, routing="isolated", semantic_steps=config.iterations)
