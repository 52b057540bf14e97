"""What of a scene the labelled frames of its teacher show; of all else nobody said what it is, and no mask holds it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.raster import rasterize
from degense.engine.scene.states import States
from degense.engine.store.run import LabelSupport

LEAST_SHOWN = 0.1  # from which a Gaussian counts as shown by the labelled frames
FAMILIAR = 0.5  # from which one looks like what they show
MAJORITY = 0.5  # of a pixel, that such Gaussians must make


class LabelledPlaces:
    """Places that at least one labelled frame shows, and those that look like what one shows.

    `support` is what the run keeps of it, `cameras` are the surgeon's of all frames.
    """

    def __init__(self, states: States, support: LabelSupport, cameras: Sequence[Camera]):
        self._states, self._frames, self._cameras = states, support.frames, cameras
        device = states.model.bounds.device
        self._shown, self._familiar = support.shown.to(device) >= LEAST_SHOWN, support.familiar.to(device) >= FAMILIAR

    @torch.no_grad()
    def pixels(self, frame: int | float, camera: Camera) -> Bool[Tensor, "height width"]:
        """Which pixels of a frame, drawn from a camera, show such places.

        Gaussians that look like what is labelled make most of the pixel; or those that a labelled frame shows do, and the point that it
        shows lies inside of that frame's view: a Gaussian at the border of the view reaches beyond it, so the point's way there is drawn as
        `motion` is.
        """
        splats = self._states.splats(frame)
        start, _ = camera.project(self._states.advected_means(frame).cpu().numpy())
        ways = [self._places(labelled)[0] - start for labelled in self._frames]
        limit = 4.0 * max(camera.width, camera.height)
        columns = np.concatenate([np.clip(way, -limit, limit) for way in ways], 1).astype(np.float32)
        kinds = torch.stack([self._shown, self._familiar], 1).float()
        features = torch.cat([kinds, torch.from_numpy(columns).to(splats.means.device)], 1)
        drawn = rasterize(splats, features, camera, clean=True)
        blended = drawn.image / drawn.alpha.clamp_min(1e-6)[..., None]
        rows, lines = torch.meshgrid(*(torch.arange(n, device=blended.device) + 0.5 for n in blended.shape[:2]), indexing="ij")
        inside = torch.zeros_like(rows, dtype=torch.bool)
        for k, labelled in enumerate(self._frames):
            inside |= _inside(lines + blended[..., 2 + 2 * k], rows + blended[..., 3 + 2 * k], self._cameras[labelled])
        return (inside & (blended[..., 0] >= MAJORITY)) | (blended[..., 1] >= MAJORITY)

    @torch.no_grad()
    def splats(self) -> Bool[Tensor, " n"]:
        """Which Gaussians look like what is labelled, or are shown by a labelled frame with their centre inside of its view."""
        inside = np.zeros(len(self._shown), bool)
        for labelled in self._frames:
            places, depth = self._places(labelled)
            inside |= (depth > 0) & _inside(places[:, 0], places[:, 1], self._cameras[labelled])
        return self._familiar | (self._shown & torch.from_numpy(inside).to(self._shown.device))

    def _places(self, labelled: int) -> tuple[np.ndarray, np.ndarray]:
        """Pixels [N, 2] and depths [N] of all centres in a labelled frame."""
        return self._cameras[labelled].project(self._states.advected_means(labelled).cpu().numpy())


def _inside(x: Any, y: Any, view: Camera) -> Any:
    """Which pixel places, arrays or tensors, lie inside of a camera's view."""
    return (x >= 0) & (x < view.width) & (y >= 0) & (y < view.height)
