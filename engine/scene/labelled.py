"""What of a scene the labelled frames of its teacher show; of all else nobody said what it is, and no mask holds it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.raster import rasterize
from degense.engine.scene.states import States

LEAST_SUPPORT = 0.1  # from which a Gaussian counts as shown by the labelled frames
MAJORITY = 0.5  # of a pixel, that such Gaussians must make


class LabelledPlaces:
    """Places that at least one labelled frame shows.

    `support` float [N] is how much of each Gaussian the labelled frames show (`engine.training.semantic.label_support`), `frames` are
    these, and `cameras` the surgeon's of all frames.
    """

    def __init__(self, states: States, support: Tensor, frames: Sequence[int], cameras: Sequence[Camera]):
        self._states, self._frames, self._cameras = states, frames, cameras
        self._supported = support.to(states.model.bounds.device) >= LEAST_SUPPORT

    @torch.no_grad()
    def pixels(self, frame: int | float, camera: Camera) -> Bool[Tensor, "height width"]:
        """Which pixels of a frame, drawn from a camera, show such places.

        Supported Gaussians make most of the pixel, and the point that it shows lies inside the view of a labelled frame: a Gaussian at the
        border of the view reaches beyond it, so the point's way there is drawn as `motion` is.
        """
        splats = self._states.splats(frame)
        start, _ = camera.project(self._states.advected_means(frame).cpu().numpy())
        ways = [self._places(labelled)[0] - start for labelled in self._frames]
        limit = 4.0 * max(camera.width, camera.height)
        columns = np.concatenate([np.clip(way, -limit, limit) for way in ways], 1).astype(np.float32)
        features = torch.cat([self._supported[:, None].float(), torch.from_numpy(columns).to(splats.means.device)], 1)
        drawn = rasterize(splats, features, camera, clean=True)
        blended = drawn.image / drawn.alpha.clamp_min(1e-6)[..., None]
        rows, lines = torch.meshgrid(*(torch.arange(n, device=blended.device) + 0.5 for n in blended.shape[:2]), indexing="ij")
        inside = torch.zeros_like(rows, dtype=torch.bool)
        for k, labelled in enumerate(self._frames):
            x, y = lines + blended[..., 1 + 2 * k], rows + blended[..., 2 + 2 * k]
            view = self._cameras[labelled]
            inside |= (x >= 0) & (x < view.width) & (y >= 0) & (y < view.height)
        return inside & (blended[..., 0] >= MAJORITY)

    @torch.no_grad()
    def splats(self) -> Bool[Tensor, " n"]:
        """Which Gaussians are supported, with their centre inside the view of a labelled frame."""
        inside = np.zeros(len(self._supported), bool)
        for labelled in self._frames:
            (x, y), depth = self._places(labelled)[0].T, self._places(labelled)[1]
            view = self._cameras[labelled]
            inside |= (depth > 0) & (x >= 0) & (x < view.width) & (y >= 0) & (y < view.height)
        return self._supported & torch.from_numpy(inside).to(self._supported.device)

    def _places(self, labelled: int) -> tuple[np.ndarray, np.ndarray]:
        """Pixels [N, 2] and depths [N] of all centres in a labelled frame."""
        return self._cameras[labelled].project(self._states.advected_means(labelled).cpu().numpy())
