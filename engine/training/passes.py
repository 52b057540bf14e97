"""The parts of a training step that always do the same work: functions of tensors only, so that a GPU can run each as a CUDA graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.field import SceneModel
from degense.engine.field.cuda_graphs import graphed
from degense.engine.field.roughness import ALONG, APART, roughness
from degense.engine.raster import Render, camera_depths, rasterize
from degense.engine.raster.camera_tensors import project
from degense.engine.raster.cuda import DrawnInGraph
from degense.engine.splats import Splats
from degense.engine.training.config import TrainConfig
from degense.engine.training.flow.motion_error import look_up, motion_error, surface_visibility
from degense.engine.training.fused.frame_cpu import frame_loss
from degense.engine.training.loss_terms import Loss
from degense.engine.training.losses import inverse_depth, nearest_neighbours, photometric, rigidity, window

NEIGHBOURS = 6
SMOOTHNESS_EVERY = 4  # steps between passes of the regularizers of planes and colour residuals, which change slowly
Neighbours = tuple[Tensor, Tensor]


class FieldState(NamedTuple):
    """What `FieldPass` finds: all Gaussians at a time, ready to be drawn."""

    means: Tensor  # these four as of `Splats`
    #: float [N, 3]; the means as they are drawn: the same, but of their gradient displacements get the share that texture is precise
    drawn_means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    features: Tensor  # float [N, 4]; colour and camera z
    loss: Tensor  # total and terms of the deformation's `Loss`
    terms: Tensor
    other_means: Tensor | None = None  # float [N, 3]; centres at the other time, where one was asked for, of the rows asked for

    @property
    def splats(self) -> Splats:
        return Splats(self.drawn_means, self.quats, self.scales, self.opacities, self.features[:, :3], self.features[:, :0])


class FieldPass:
    """All Gaussians at a frame's time, their centres at another time, and the regularizers of their deformation.

    Without `deform`, in the coarse stage, the Gaussians are drawn where they are, and the field learns from optical flow alone.
    """

    def __init__(self, model: SceneModel, config: TrainConfig, neighbours: Neighbours | None, *, deform: bool):
        self.model, self.config, self.neighbours, self.deform = model, config, neighbours, deform

    def __call__(
        self,
        t: Tensor,
        camera: Tensor,
        precision: Tensor,
        other: Tensor | None = None,
        rows: Tensor | None = None,
        present: Tensor | None = None,
    ) -> tuple[Tensor, ...]:
        """The fields of a `FieldState`, the last of them only with `other`, float [] like `t`; `camera` is `view_and_lens`.

        `precision`, float16 [1, h, w], is how well the texture of this frame pins motion down (`FlowSupervision.precision`): colour teaches
        displacements that much. An empty one stands for 1 everywhere.
        With `rows`, int64 [m], which needs `deform`, the centres at the other time are those of so many Gaussians. With `present`, int64
        [k], only so many are deformed, and only they move as those of their neighbours do that are present too.
        """
        config, state = self.config, self.model.at(t, deform=self.deform, semantics=False, other=other, rows=rows, present=present)
        splats, d, terms = state.splats, state.deformation, dict[str, Tensor]()
        if d is not None:
            terms["shape"] = config.shape * (d.log_scales.abs().mean() + d.quats.abs().mean() + d.opacities.abs().mean())
        shift = d.means if d is not None else None if state.means_at_other is None else state.means_at_other - splats.means
        if shift is not None:
            terms["displacement"] = config.displacement * (shift.square().sum(1) + 1e-8).sqrt().mean()
            if self.neighbours is not None:
                terms["rigidity"] = config.rigidity * rigidity(shift, *self._neighbours_among(present))
        if state.delta_color is not None:
            terms["delta_color"] = config.delta_color * state.delta_color.abs().mean()
        z = splats.means @ camera[2, :3] + camera[2, 3]
        features = torch.cat([splats.colors, z[:, None]], 1)
        drawn = splats.means
        if d is not None and len(precision):
            noisy = 1 - look_up(precision.float(), project(splats.means.detach(), camera)[0] * 2 - 1)
            drawn = drawn - noisy * (d.means - d.means.detach())
        found = (
            splats.means,
            drawn,
            splats.quats,
            splats.scales,
            splats.opacities,
            features,
            *Loss.of("deformation", terms, z.new_zeros(())),
        )
        return found if state.means_at_other is None else (*found, state.means_at_other)

    def _neighbours_among(self, present: Tensor | None) -> Neighbours:
        """The neighbours, of which those that are not both `present` do not count."""
        assert self.neighbours is not None
        index, weight = self.neighbours
        if present is None:
            return index, weight
        there = torch.zeros(len(index)).index_fill_(0, present, 1.0)
        return index, weight * there[:, None] * there[index]


class SmoothnessPass:
    """Regularizers of what is stored over time: planes that are rough, in space or in time, and colours that change."""

    def __init__(self, model: SceneModel, config: TrainConfig):
        self.model, self.config = model, config

    def __call__(self, weight: Tensor) -> tuple[Tensor, ...]:
        """The fields of a `Loss`, times `weight`, float []."""
        config = self.config
        space, curvature, constancy = self.model.planes.smoothness()
        terms = {
            "plane_space": config.plane_space * space,
            "plane_time": config.plane_time * curvature,
            "plane_static": config.plane_static * constancy,
        }
        if self.model.config.color_knots > 1:
            residuals = self.model.canonical["color_residuals"]
            size, change = roughness(residuals[None], APART, ALONG)
            terms["color_residual"] = config.color_residual * size
            terms["color_residual_change"] = config.color_residual_change * change
        return Loss.of("smoothness", terms, weight.new_zeros(())).times(weight)


class FrameLoss:
    """How far a drawn frame is from the recorded one; `depth` is the weight of its depth."""

    def __init__(self, config: TrainConfig, *, depth: float):
        self.config, self.depth = config, depth

    def __call__(self, image: Tensor, alpha: Tensor, recorded: Tensor, visible: Tensor, known: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """The fields of a `Loss`, and the mean squared error of colour over valid pixels.

        `image`, float [H, W, 4], is colour and blended z; `recorded`, `visible` and `known` are a `Frame`.
        """
        if image.device.type == "cpu" and image.dtype == torch.float32:
            weights = (1 - self.config.ssim, self.config.ssim, self.depth)
            return frame_loss(image, alpha, (recorded, visible, known), weights, window())
        color, target, valid = image[..., :3], recorded.float() / 255, visible.float()
        terms = dict(zip(("l1", "ssim"), photometric(color, target, valid, self.config.ssim), strict=True))
        if self.depth > 0:
            terms["depth"] = self.depth * inverse_depth(image[..., 3], alpha, known, valid)
        error = ((color.detach() - target).square() * valid[..., None]).sum() / (3 * valid.sum().clamp_min(1))
        return *Loss.of("frame", terms, alpha.new_zeros(())), error


class FlowLoss:
    """How far the Gaussians that a drawn frame shows on its surface move otherwise than the optical flow."""

    def __init__(self, config: TrainConfig):
        self.config = config

    def __call__(
        self, here: Tensor, there: Tensor, opacities: Tensor, radii: Tensor, image: Tensor, alpha: Tensor, camera: Tensor, *pair: Tensor
    ) -> tuple[Tensor, ...]:
        """The fields of a `Loss`; `image` is [H, W, 4], and `camera` and `pair` are `FlowSupervision.inputs`."""
        visible = surface_visibility(here, opacities, radii, image[..., 3], alpha, camera)
        error = motion_error(here, there, visible, camera, *pair)
        return Loss.of("flow", {"flow": self.config.flow * error}, error.new_zeros(()))


class SemanticPass:
    """The scene with its latents at one time. `isolated` gives geometry without a gradient, so that none of L_sem can reach a shape."""

    def __init__(self, model: SceneModel, config: TrainConfig, *, deform: bool):
        self.model, self.config, self.deform = model, config, deform

    def __call__(self, t: Tensor) -> tuple[Tensor, ...]:
        """Means, quaternions, scales, opacities, latents, and the regularizer of their change."""
        state = self.model.at(t, deform=self.deform)
        place = state.splats.detach() if self.config.routing == "isolated" else state.splats
        change = state.delta_semantics
        regularizer = self.config.delta_semantics * change.abs().mean() if change is not None else state.splats.semantics.new_zeros(())
        return place.means, place.quats, place.scales, place.opacities, state.splats.semantics, regularizer


class Passes:
    """The passes of a trainer, as CUDA graphs where there is a GPU. `forget` them when the Gaussians or the stage have changed.

    With `in_step_graph` those that each step makes are functions, of which `engine.training.step_graph` makes a graph of its own.
    """

    def __init__(self, model: SceneModel, config: TrainConfig, *, depth: float, semantics: bool, in_step_graph: bool):
        self.model, self.config, self.semantics, self.in_step_graph = model, config, semantics, in_step_graph
        #: Index and weight of the canonical centres, for local rigidity; found again when it is None.
        self.neighbours: Neighbours | None = None
        self._functions: dict[str, Callable[..., tuple[Tensor, ...]]] = {"frame": FrameLoss(config, depth=depth), "flow": FlowLoss(config)}
        self._graphs: dict[str, Callable[..., tuple[Tensor, ...]]] = {}

    @property
    def ready(self) -> bool:
        """Whether the passes that read the model have been made."""
        return "field" in self._graphs

    def make(self, asked: Sequence[Tensor | None], smoothness_weight: Tensor, *, deform: bool, learn: bool) -> None:
        """Make the passes that read the model, for arguments of `FieldPass` like `asked`. No gradient may be on its way.

        Without `learn` the field stays as it is: nothing gives it a gradient.
        """
        if self.model.bounds.is_cuda:
            torch.cuda.empty_cache()
        for part in (self.model.planes, self.model.kinematics, self.model.geometry, self.model.appearance):
            if part is not None:
                part.requires_grad_(learn)
        if self.config.rigidity > 0 and self.neighbours is None:
            self.neighbours = nearest_neighbours(self.model.canonical["means"].detach(), NEIGHBOURS)
        parameters, examples = list(self.model.parameters()), [value for value in asked if value is not None]
        field = FieldPass(self.model, self.config, self.neighbours, deform=deform)
        self._graphs["field"] = field if self.in_step_graph else graphed(field, examples, parameters)
        planes = max(self.config.plane_space, self.config.plane_time, self.config.plane_static) > 0
        if (learn and planes) or self.model.config.color_knots > 1:
            self._graphs["smoothness"] = graphed(SmoothnessPass(self.model, self.config), (smoothness_weight,), parameters)
        if self.semantics:
            self._graphs["semantic"] = graphed(SemanticPass(self.model, self.config, deform=deform), examples[:1], parameters)

    def smooths(self, iteration: int) -> bool:
        """Whether a step has the regularizers of what is stored over time: one in `SMOOTHNESS_EVERY`, where there are any."""
        return "smoothness" in self._graphs and iteration % SMOOTHNESS_EVERY == 0

    def __call__(self, name: str, *arguments: Tensor | None) -> tuple[Tensor, ...]:
        """Run a pass; those of a drawn frame are made at their first use."""
        if name not in self._graphs:
            function, examples = self._functions[name], [value for value in arguments if value is not None]
            self._graphs[name] = function if self.in_step_graph else graphed(function, examples)
        return self._graphs[name](*arguments)

    def losses(
        self,
        field: FieldState,
        drawn: Render | DrawnInGraph,
        recorded: Sequence[Tensor],
        flow: Sequence[Tensor],
        rows: Tensor | None = None,
    ) -> tuple[dict[str, Loss], Tensor]:
        """The parts of the loss that every step has, and the mean squared error of its picture.

        `recorded` is a `Frame`, `flow` what `FlowSupervision.inputs` knows of the field's other time, `rows` the Gaussians that it asks.
        """
        *found, squared_error = self("frame", drawn.image, drawn.alpha, *recorded)
        losses = {"deformation": Loss(field.loss, field.terms), "frame": Loss(*found)}
        if field.other_means is not None:
            of_all = field.means, field.opacities, drawn.radii
            means, opacities, radii = of_all if rows is None else (values.index_select(0, rows) for values in of_all)
            losses["flow"] = Loss(*self("flow", means, field.other_means, opacities, radii, drawn.image, drawn.alpha, *flow))
        return losses, squared_error

    def forget(self) -> None:
        """Make all passes anew but that of the frame, whose shapes never change."""
        self._graphs = {name: graph for name, graph in self._graphs.items() if name == "frame"}


def draw(splats: Splats, camera: Camera) -> Render:
    """Colour and z in one pass: image [H, W, 4]."""
    return rasterize(splats, torch.cat([splats.colors, camera_depths(splats.means, camera)[:, None]], 1), camera)


def draw_latents(splats: Splats, camera: Camera, *, detached: bool) -> Tensor:
    """Latent map [H, W, d]. With `detached` geometry nothing but the latents receives a gradient."""
    return rasterize(splats.detach() if detached else splats, splats.semantics, camera).image
