"""Votes of the 4D field: corrected labels are back-projected to the Gaussians, which are then drawn at other times."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from degense.engine.annotation.propagation.flow_votes import nearness
from degense.engine.raster import backproject, rasterize
from degense.engine.scene import Scene

#: Total share of pixels below which a Gaussian counts little.
LEAST_SEEN = 0.1
#: Mean difference in colour (0 to 1) between the rendered and the recorded pixel at which a vote counts 1/e.
UNLIKE = 0.15


class FieldVotes:
    """Votes of the Gaussians of a scene that has the frames and the size of the label maps.

    `labels` int64 [H, W] by frame are 0 … count − 1; `valid` bool [H, W] by frame are the pixels that the scene reconstructs.
    """

    def __init__(self, scene: Scene, labels: Mapping[int, np.ndarray], valid: Mapping[int, np.ndarray], count: int):
        self._scene = scene
        self._seen = {frame: self._backproject(frame, labels[frame], valid[frame], count) for frame in labels}

    def _backproject(self, frame: int, labels: np.ndarray, valid: np.ndarray, count: int) -> Tensor:
        """Σ_p w_ip [L(p) = k] over the valid pixels of a frame, [N, count]; w_ip is the share of Gaussian i in pixel p."""
        splats = self._scene.splats(frame)
        named = torch.nn.functional.one_hot(torch.from_numpy(labels), count) * torch.from_numpy(valid)[..., None]
        return backproject(splats, named.to(splats.means), self._scene.camera(frame), clean=True).total

    @torch.no_grad()
    def at(self, frame: int, observed: np.ndarray) -> np.ndarray:
        """Shares of the labels in each pixel, float32 [H, W, count], less where the recorded frame, uint8 [H, W, 3], looks different."""
        weights = nearness(frame, list(self._seen))
        total = sum(weight * seen for weight, seen in zip(weights, self._seen.values(), strict=True))
        assert isinstance(total, Tensor)
        shares = total / (total.sum(1, keepdim=True) + LEAST_SEEN)
        splats = self._scene.splats(frame)
        features = torch.cat([shares, splats.colors], 1)
        drawn = rasterize(splats, features, self._scene.camera(frame), clean=True)
        image = drawn.image.cpu().numpy()
        unlike = np.abs(image[..., -3:].clip(0, 1) - observed.astype(np.float32) / 255).mean(-1)
        return image[..., :-3] * np.exp(-((unlike / UNLIKE) ** 2))[..., None]
