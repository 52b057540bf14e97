"""The systems that the paper compares, as settings of one training.

All share what is not in question: the field (HexPlane, Z_kin, Ψ_geo), the rasterizer, the first Gaussians from the clip's depth,
densification, Adam and its rates, and the teacher with its basis and its weights of rare classes. None of the peers' own autoencoders
(512 → 3 dimensions), segmenters (SAM) or vision-language models is here: all systems are trained on the same text vectors, in a
basis that keeps their angles. The peers' regularizers of renders (total variation) are left out, and none of ours on motion is put in
their place. Their semantic loss, a mean over 3 channels with weight 1, is a sum over some 8 channels with weight 0.2 here, which is as
large. Those that train everything together take it in every second or third step, as the preset has it: in every step their masks and
renders are worse.
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
    return replace(langsplat(config), codebook=True)


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
    "degense": degense,
}


def as_system(name: str, config: TrainConfig) -> TrainConfig:
    """The settings with which a system trains, on the budget of `config`. DegenseError for an unknown system."""
    if name not in SYSTEMS:
        raise DegenseError(f"there is no system {name!r}; choose from {', '.join(SYSTEMS)}")
    return SYSTEMS[name](config)


def words_of(name: str) -> str:
    """What a system is: what is kept of the original, and what is not."""
    return inspect.getdoc(SYSTEMS[name]) or ""


def _peer(config: TrainConfig) -> TrainConfig:
    """Without what no peer has: flow supervision, regularizers of motion, appearance, temporal windows, angular loss, back-projection."""
    without: dict[str, Any] = {
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
        "lift": False,
        "early_stopping": False,
        "fixed_latents": True,
    }
    return replace(config, **without)


def _afterwards(config: TrainConfig) -> TrainConfig:
    """Semantics after geometry, with as many steps."""
    return replace(config, routing="isolated", semantic_steps=config.iterations)
