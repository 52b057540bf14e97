"""The Gaussians of a run over time, evaluated once an instant and then kept."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.field import SceneModel
from degense.engine.field.live import LiveField
from degense.engine.latest import Latest
from degense.engine.motion import displacement
from degense.engine.scene.uncertainty import error_bound, is_guess, revealed_around
from degense.engine.splats import Splats

STATE_BYTES = 1 << 30


class States:
    """Baked states of a trained scene. Lengths are in the clip's unit; frames may be fractional.

    Lengths of the model are those of the clip, times `unit`. Displacement is measured from the reference frame. `observability` float [N]
    is the share of its frames in which the recording reveals how far each Gaussian has moved; None for a run that kept none.
    """

    def __init__(self, model: SceneModel, unit: float, frames: int, reference_frame: int, observability: Tensor | None):
        self.model, self.unit, self.frames, self.reference_frame = model, unit, frames, reference_frame
        self.observability = observability.to(model.bounds.device) if observability is not None else None
        self._cache = Latest(STATE_BYTES)

    def time(self, frame: float) -> float:
        """The field's time of a frame, in [-1, 1]."""
        return 2.0 * frame / (self.frames - 1) - 1.0 if self.frames > 1 else 0.0

    @cached_property
    def live(self) -> LiveField:
        """The scene at any time, not kept; what it returns is overwritten by its next call."""
        return LiveField(self.model, 1.0 / self.unit)

    def splats(self, frame: float, *, semantics: bool = False) -> Splats:
        """All Gaussians at a frame. `semantics` False: latents may be missing (rank 0), since most views need none."""
        whole = semantics or (float(frame), True) in self._cache
        if whole:
            self._cache.forget((float(frame), False))
        return self._cache.get(
            (float(frame), whole),
            lambda: self.live(self.time(frame), semantics=whole).map(Tensor.clone),
            lambda splats: sum(tensor.nbytes for tensor in vars(splats).values()),
        )

    def advected_means(self, frame: float) -> Tensor:
        """Centres [N, 3] at a frame as the deformation field alone moves them, without the linear velocity of transient Gaussians.

        Displacement and speed are measured on them: an instrument has no place at the reference frame that it could have moved from.
        """
        return self.splats(frame).means - self.model.linear_motion(self.time(frame)) / self.unit

    def displacement(self, frame: float) -> Tensor:
        """‖μ(t) − μ(reference)‖ of every Gaussian [N], by `advected_means`."""
        return displacement(self.advected_means(frame), self.advected_means(self.reference_frame))

    @property
    def depth(self) -> float:
        """The scene's depth, which is 1 to the model, clip units."""
        return 1 / self.unit

    def guesses(self, frame: float) -> Tensor:
        """Of which Gaussians the displacement is a guess, bool [N]."""
        return is_guess(self.uncertainty(frame), self.displacement(frame), self.depth)

    def uncertainty(self, frame: float) -> Tensor:
        """How far off the displacement of each Gaussian [N] may be, clip units: kept in nine of ten places. See `error_bound`.

        The scene's depth for transient ones, which have no place at the reference frame to have moved from, and 0 at that frame itself.
        ValueError for a run that does not say what its recording reveals.
        """
        moved = self.advected_means(frame) - self.advected_means(self.reference_frame)
        bound = error_bound(moved, self._revealed_around, self.depth)
        return bound if frame == self.reference_frame else torch.where(self.model.persistent, bound, self.depth)

    @cached_property
    def _revealed_around(self) -> Tensor:
        if self.observability is None:
            raise ValueError("the run kept no motion observability")
        return revealed_around(self.advected_means(self.reference_frame), self.observability * self.model.persistent)

    @cached_property
    def persistent(self) -> Tensor:
        """Rows of the persistent Gaussians, int64 [M]: tissue; instruments, blood and char are transient."""
        return self.model.persistent.nonzero()[:, 0]

    @cached_property
    def feature_axes(self) -> np.ndarray:
        """Three directions [d, 3] along which the latents differ most, the same at every frame."""
        latents = self.splats(self.reference_frame, semantics=True).semantics.cpu().numpy().astype(np.float64)
        latents /= np.maximum(np.linalg.norm(latents, axis=1, keepdims=True), 1e-6)
        _, _, axes = np.linalg.svd(latents - latents.mean(0), full_matrices=False)
        axes = axes[:3].T
        return np.pad(axes, ((0, 0), (0, 3 - axes.shape[1])))

    def screen_motion(self, frame: float, camera: Camera, reference: Camera) -> Tensor:
        """Pixels [N, 2] from each Gaussian's place in `camera` at a frame to its place in the camera `reference` at the reference frame.

        Held within four times the size of the image.
        """
        here = self.advected_means(frame)
        start, _ = camera.project(here.cpu().numpy())
        end, _ = reference.project(self.advected_means(self.reference_frame).cpu().numpy())
        limit = 4.0 * max(camera.width, camera.height)
        return torch.from_numpy(np.clip(end - start, -limit, limit)).float().to(here.device)
