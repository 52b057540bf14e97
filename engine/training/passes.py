"""The parts of a training step that always do the same work: functions of tensors only, so that a GPU can run each as one recording."""

from __future__ import annotations

import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.training.config import TrainConfig
from degense.engine.training.flow.supervision import motion_error, surface_visibility
from degense.engine.training.losses import inverse_depth, photometric, rigidity

Neighbours = tuple[Tensor, Tensor]


class FieldPass:
    """What a step asks of the scene: all Gaussians at the frame's time, their centres at another time, and the price of moving them.

    Parameters
    ----------
    model : SceneModel
    config : TrainConfig
    neighbours : (index, weight) or None
        For local rigidity.
    deform : bool
        False in the coarse stage: the Gaussians are drawn where they are, and the field learns from motion evidence alone.
    """

    def __init__(self, model: SceneModel, config: TrainConfig, neighbours: Neighbours | None, *, deform: bool):
        self.model, self.config, self.neighbours, self.deform = model, config, neighbours, deform

    def __call__(self, t: Tensor, camera: Tensor, other: Tensor | None = None) -> tuple[Tensor, ...]:
        """Means, quaternions, scales, opacities, features [N, 4] (colour and camera z), price of motion, and centres at `other`.

        Parameters
        ----------
        t, other : float []
            `other` only where there is motion evidence.
        camera : float [5, 4]
            `view_and_lens`.
        """
        config, state = self.config, self.model.at(t, deform=self.deform, semantics=False, other=other)
        splats, d = state.splats, state.deformation
        regularizer = splats.means.new_zeros(())
        if d is not None:
            regularizer = regularizer + config.shape * (d.log_scales.abs().mean() + d.quats.abs().mean() + d.opacities.abs().mean())
        shift = d.means if d is not None else None if state.means_at_other is None else state.means_at_other - splats.means
        if shift is not None:
            regularizer = regularizer + config.displacement * (shift.square().sum(1) + 1e-8).sqrt().mean()
            if self.neighbours is not None:
                regularizer = regularizer + config.rigidity * rigidity(shift, *self.neighbours)
        if state.delta_color is not None:
            regularizer = regularizer + config.delta_color * state.delta_color.abs().mean()
        z = splats.means @ camera[2, :3] + camera[2, 3]
        features = torch.cat([splats.colors, z[:, None]], 1)
        drawn = (splats.means, splats.quats, splats.scales, splats.opacities, features)
        return (*drawn, regularizer) if state.means_at_other is None else (*drawn, regularizer, state.means_at_other)


class CurvePass:
    """The price of what is kept over time: planes that are rough, in space or in time, and colours that differ."""

    def __init__(self, model: SceneModel, config: TrainConfig):
        self.model, self.config = model, config

    def __call__(self, weight: Tensor) -> tuple[Tensor]:
        """The sum of the regularisers, times `weight`, float []."""
        config = self.config
        space, curvature, stillness = self.model.planes.smoothness()
        regularizer = config.plane_space * space + config.plane_time * curvature + config.plane_static * stillness
        if self.model.config.color_knots > 1:
            color_residuals = self.model.canonical["color_residuals"]
            regularizer = (
                regularizer
                + config.color_residual * color_residuals.abs().mean()
                + config.color_residual_change * color_residuals.diff(dim=1).square().mean()
            )
        return (regularizer * weight,)


class PictureLoss:
    """How far a drawn frame is from the recorded one."""

    def __init__(self, config: TrainConfig, *, depth: bool):
        self.config, self.depth = config, depth

    def __call__(self, image: Tensor, alpha: Tensor, recorded: Tensor, visible: Tensor, known: Tensor) -> tuple[Tensor, Tensor]:
        """The loss, and the mean squared error of colour over valid pixels.

        Parameters
        ----------
        image : float [H, W, 4]
            Colour and blended z.
        alpha : float [H, W]
        recorded, visible, known
            `Frame.image`, `Frame.valid` and `Frame.depth`.
        """
        color, target, valid = image[..., :3], recorded.float() / 255, visible.float()
        loss = photometric(color, target, valid, self.config.ssim)
        if self.depth:
            loss = loss + self.config.depth * inverse_depth(image[..., 3], alpha, known, valid)
        error = ((color.detach() - target).square() * valid[..., None]).sum() / (3 * valid.sum().clamp_min(1))
        return loss, error


def motion_loss(
    here: Tensor, there: Tensor, opacities: Tensor, radii: Tensor, image: Tensor, alpha: Tensor, camera: Tensor, *pair: Tensor
) -> tuple[Tensor]:
    """`motion_error` of the Gaussians that a drawn frame [H, W, 4] shows on its surface; `pair` continues `MotionEvidence.inputs`."""
    visible = surface_visibility(here, opacities, radii, image[..., 3], alpha, camera)
    return (motion_error(here, there, visible, camera, *pair),)


class SemanticPass:
    """The scene with its latents at one time. `isolated` gives geometry without a gradient, so that none of L_sem can reach a shape."""

    def __init__(self, model: SceneModel, config: TrainConfig, *, deform: bool):
        self.model, self.config, self.deform = model, config, deform

    def __call__(self, t: Tensor) -> tuple[Tensor, ...]:
        """Means, quaternions, scales, opacities, latents, and the price of changing them."""
        state = self.model.at(t, deform=self.deform)
        place = state.splats.detach() if self.config.routing == "isolated" else state.splats
        change = state.delta_semantics
        regularizer = self.config.delta_semantics * change.abs().mean() if change is not None else state.splats.semantics.new_zeros(())
        return place.means, place.quats, place.scales, place.opacities, state.splats.semantics, regularizer
