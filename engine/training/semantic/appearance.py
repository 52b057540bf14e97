"""What a teacher calls all that looks alike: a small network from the look of a pixel to the teacher's words, fitted to one clip.

It has few numbers for the labels of all frames, so it learns what they agree on and not the mistakes of single frames.
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from torch import Tensor, nn

SCALES = (1, 2, 4, 8)  # pixels: σ of the neighbourhoods that are looked at
WIDTH = 64  # units of a hidden layer
STEPS, BATCH, RATE = 400, 4096, 3e-3
EPOCHS = 20  # at most


def look(image: UInt8[np.ndarray, "height width 3"]) -> Float32[np.ndarray, "height width features"]:
    """CIELAB of each pixel; in neighbourhoods of growing size its mean, its standard deviation and the slope of its lightness."""
    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    found = [lab]
    for scale in SCALES:
        mean, square = (cv2.GaussianBlur(values, (0, 0), scale) for values in (lab, lab * lab))
        slope = np.hypot(cv2.Sobel(mean[..., 0], -1, 1, 0), cv2.Sobel(mean[..., 0], -1, 0, 1))
        found += [mean, np.sqrt(np.maximum(square - mean * mean, 0)), slope[..., None]]
    return np.concatenate(found, -1)


class Appearance:
    """p(word | look) of a clip, by a network of two hidden layers.

    `features` [P, F] are looks of pixels of all frames, `shares` [P, K] what the teacher calls them, rows of sum 1.
    """

    def __init__(self, features: Float[Tensor, "pixels features"], shares: Float[Tensor, "pixels words"], seed: int):
        self._mean, self._scale = features.mean(0), features.std(0) + 1e-6
        random = torch.Generator().manual_seed(seed)
        sizes = (features.shape[1], WIDTH, WIDTH, shares.shape[1])
        layers: list[nn.Module] = []
        for inputs, outputs in pairwise(sizes):
            layer = nn.Linear(inputs, outputs)
            with torch.no_grad():
                for parameter in layer.parameters():
                    parameter.copy_((torch.rand(parameter.shape, generator=random) * 2 - 1) / inputs**0.5)
            layers += [layer, nn.SiLU()]
        self._network = nn.Sequential(*layers[:-1]).to(features.device)
        optimizer = torch.optim.AdamW(self._network.parameters(), RATE, weight_decay=1e-4)
        steps = min(STEPS, EPOCHS * len(features) // BATCH + 1)
        for step in range(steps):
            optimizer.param_groups[0]["lr"] = RATE * (1 - step / steps)
            rows = torch.randint(len(features), (BATCH,), generator=random).to(features.device)
            loss = nn.functional.cross_entropy(self._network(self._scaled(features[rows])), shares[rows])
            optimizer.zero_grad(set_to_none=True)
            loss.backward()
            optimizer.step()

    @torch.no_grad()
    def __call__(self, features: Float[Tensor, "pixels features"]) -> Float[Tensor, "pixels words"]:
        """log p(word | look)."""
        return torch.log_softmax(self._network(self._scaled(features)), 1)

    def _scaled(self, features: Tensor) -> Tensor:
        return (features - self._mean) / self._scale
