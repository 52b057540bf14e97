"""What a teacher calls all that looks alike: a small network from the look of a pixel to the teacher's words, fitted to one clip.

It has few numbers for the labels of all frames, so it learns what they agree on and not the mistakes of single frames.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from torch import Tensor, nn

from degense.engine.field.cuda_graphs import graphed
from degense.engine.threads import many_torch_threads
from degense.engine.training.adam import Adam

SCALES = (1, 2, 4, 8)  # pixels: σ of the neighbourhoods that are looked at
WIDTH = 64  # units of a hidden layer
STEPS, BATCH, RATE, DECAY = 400, 4096, 3e-3, 1e-4
EPOCHS = 20  # at most
ROWS = 8192  # asked at once: what lies between the layers stays in the processor's cache
SMOOTH, DIFFERENCE = np.array([1, 2, 1], np.float32), np.array([-1, 0, 1], np.float32)  # Sobel's


class Looks:
    """How pixels look: CIELAB; and in neighbourhoods of growing size its mean, its standard deviation and the slope of its lightness.

    For frames of one size, width and height. On a GPU neighbourhoods are products with matrices: one blurs along columns, one along rows.
    """

    def __init__(self, size: tuple[int, int], device: torch.device):
        self._size, self._device = size, device

    def __call__(self, image: UInt8[np.ndarray, "height width 3"]) -> Float[Tensor, "pixels features"]:
        lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
        if self._device.type == "cuda":
            return self.by_products(torch.from_numpy(lab).to(self._device))
        found = [lab]
        for scale in SCALES:
            mean, square = (cv2.GaussianBlur(values, (0, 0), scale) for values in (lab, lab * lab))
            slope = np.hypot(cv2.Sobel(mean[..., 0], -1, 1, 0), cv2.Sobel(mean[..., 0], -1, 0, 1))
            found += [mean, np.sqrt(np.maximum(square - mean * mean, 0)), slope[..., None]]
        features = np.concatenate(found, -1)
        return torch.from_numpy(features.reshape(-1, features.shape[2]))

    @cached_property
    def _filters(self) -> list[list[Tensor]]:
        """Matrices along rows and along columns: the blurs by scale, then Sobel's two."""
        taps = [*map(_gaussian, SCALES), SMOOTH, DIFFERENCE]
        return [[_matrix(length, along, self._device) for length in self._size] for along in taps]

    def by_products(self, lab: Float[Tensor, "height width 3"]) -> Float[Tensor, "pixels features"]:
        """The looks of a frame in CIELAB, on the tensor's device."""
        planes = lab.permute(2, 0, 1)
        both, found = torch.cat([planes, planes * planes]), [planes]
        *blurs, (smooth_x, smooth_y), (difference_x, difference_y) = self._filters
        for along_rows, along_columns in blurs:
            mean, square = (along_columns @ both @ along_rows.T).split(3)
            lightness = mean[:1]
            slope = torch.hypot(smooth_y @ lightness @ difference_x.T, difference_y @ lightness @ smooth_x.T)
            found += [mean, (square - mean * mean).clamp_min(0).sqrt(), slope]
        return torch.cat(found).flatten(1).T.contiguous()


def _gaussian(scale: int) -> Float32[np.ndarray, " taps"]:
    """The taps of OpenCV's blur of floating-point numbers with σ = `scale`."""
    return np.ravel(cv2.getGaussianKernel(round(scale * 8 + 1) | 1, scale, cv2.CV_32F))


def _matrix(length: int, taps: Float32[np.ndarray, " taps"], device: torch.device) -> Float[Tensor, "length length"]:
    """The matrix that filters `length` numbers in a column, mirrored at the ends."""
    return torch.from_numpy(cv2.sepFilter2D(np.eye(length, dtype=np.float32), -1, np.ones(1, np.float32), taps)).to(device)


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
        parameters, asked = list(self._network.parameters()), [values.new_zeros(BATCH, values.shape[1]) for values in (features, shares)]
        loss, optimizer = graphed(self._loss, asked, parameters), Adam([{"params": parameters, "lr": RATE}], decay=DECAY)
        steps = min(STEPS, EPOCHS * len(features) // BATCH + 1)
        with many_torch_threads():
            for step in range(steps):
                optimizer.param_groups[0]["lr"] = RATE * (1 - step / steps)
                rows = torch.randint(len(features), (BATCH,), generator=random).to(features.device)
                optimizer.zero_grad()
                loss(features.index_select(0, rows), shares.index_select(0, rows))[0].backward()
                optimizer.step()

    def _loss(self, features: Float[Tensor, "pixels features"], shares: Float[Tensor, "pixels words"]) -> tuple[Tensor]:
        return (nn.functional.cross_entropy(self._network(self._scaled(features)), shares),)

    @torch.no_grad()
    def __call__(self, features: Float[Tensor, "pixels features"]) -> Float[Tensor, "pixels words"]:
        """log p(word | look)."""
        return torch.cat([torch.log_softmax(self._network(self._scaled(rows)), 1) for rows in features.split(ROWS)])

    def _scaled(self, features: Tensor) -> Tensor:
        return (features - self._mean) / self._scale
