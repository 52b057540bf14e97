"""A scene whose geometry is finished, at the times of its frames: what does not change any more is computed once and kept."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.field.networks_cpu import branch
from degense.engine.latest import Latest
from degense.engine.raster import Placed
from degense.engine.splats import Splats
from degense.engine.training.config import TrainConfig
from degense.engine.training.frames import TrainingFrames

KEPT_BYTES = 1 << 28  # of all frames


class FinishedGeometry:
    """The Gaussians of a model at the times of its frames, without latents."""

    def __init__(self, model: SceneModel, frames: TrainingFrames):
        self.model, self.frames = model, frames
        self._kept, self._placed = Latest(KEPT_BYTES), Latest(KEPT_BYTES)

    def splats(self, frame: int) -> Splats:
        """The Gaussians at the time of a frame, without a gradient."""
        return self._kept.get(frame, lambda: self._found(frame), lambda splats: _bytes(*vars(splats).values()))

    def placed(self, frame: int) -> Placed:
        """The same on the screen of the frame's camera."""
        return self._placed.get(frame, lambda: Placed(self.splats(frame), self.frames.cameras[frame]), lambda placed: placed.nbytes)

    @torch.no_grad()
    def _found(self, frame: int) -> Splats:
        return self.model.at(self.frames.clip.time(frame), semantics=False).splats


class Moment(NamedTuple):
    """What of a frame's latents does not change while semantics are learned (`isolated`)."""

    present: Tensor  # int64 [k]; the Gaussians that may be drawn; the latents of the others are of no account, and not changed
    kinematic: Tensor  # float [k, 64]; their Z_kin
    by_color: Tensor | None  # float [N, rank]; what a change of colour adds to the latents; None where they follow no colour


class FinishedLatents:
    """The fused twin of `SemanticPass` with routing `isolated`, on the CPU, for frames in place of times.

    Call it when `semantic_coefficients` are known: they are part of what is kept.
    """

    def __init__(self, geometry: FinishedGeometry, config: TrainConfig):
        self._geometry, self._model, self._frames, self._config = geometry, geometry.model, geometry.frames, config
        self._moments = Latest(KEPT_BYTES)
        self._points = self._model.normalised(self._model.canonical["means"].detach())

    def __call__(self, frame: int) -> tuple[Tensor, Tensor]:
        """The latents of the Gaussians, and the regularizer of their change."""
        model = self._model
        moment = self._moments.get(frame, lambda: self._moment(frame), lambda kept: _bytes(*kept))
        latents, change = model.canonical["semantics"], self._change(frame, moment)
        regularizer = latents.new_zeros(()) if change is None else self._config.delta_semantics * change.abs().sum() / latents.numel()
        latents = latents if change is None else latents.index_add(0, moment.present, change)
        return latents if moment.by_color is None else latents + moment.by_color, regularizer

    def _change(self, frame: int, moment: Moment) -> Tensor | None:
        """Δf_sem of the Gaussians that are present, from Z_kin and the semantic planes."""
        head, planes = self._model.semantic, self._model.semantic_planes
        if head is None or planes is None:
            return None
        features = planes(self._points.index_select(0, moment.present), self._frames.clip.time(frame))
        return branch(torch.cat([moment.kinematic, features], 1), head.decode)

    @torch.no_grad()
    def _moment(self, frame: int) -> Moment:
        model, by_color = self._model, None
        if model.semantic_coefficients is not None:
            change = self._geometry.splats(frame).colors - model.canonical["colors"]
            by_color = (change[:, :, None] * model.semantic_coefficients).sum(1)
        time = self._frames.clip.time(frame)
        present = model.present(time)
        return Moment(present, model.kinematics(model.planes(self._points.index_select(0, present), time)), by_color)


def _bytes(*tensors: Tensor | None) -> int:
    return sum(tensor.numel() * tensor.element_size() for tensor in tensors if tensor is not None)
