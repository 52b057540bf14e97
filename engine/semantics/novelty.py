"""How unlike the surroundings of a pixel are to all that was shown before: what looks new has no known name."""

from __future__ import annotations

from copy import copy

import cv2
import numpy as np
import torch
from jaxtyping import Float32, UInt8
from torch import Tensor

from degense.engine.threads import one_torch_thread

KNOWN = 1000  # pixels that others are compared with


class Novelty:
    """The distance of a pixel's surroundings to the nearest known ones, by what is usual among these.

    `known` float32 [n, 13] are the `surroundings` of pixels that were shown before. Compared with in units of their spread.
    """

    def __init__(self, known: Float32[np.ndarray, "n features"], seed: int = 0):
        self._mean, self._spread = known.mean(0), known.std(0) + 1e-6
        drawn = self.scaled(known)[torch.randperm(len(known), generator=torch.Generator().manual_seed(seed))]
        self._known = drawn[:KNOWN]
        self._usual = float(torch.cdist(drawn[KNOWN : 2 * KNOWN], self._known).amin(1).median()) if len(drawn) > KNOWN else 1.0

    def beside(self, some: Float32[np.ndarray, "n features"]) -> Novelty:
        """The distance to the nearest of some of the known ones only, in the same units."""
        found = copy(self)
        found._known = self.scaled(some[:: -(-len(some) // KNOWN)])
        return found

    def scaled(self, values: Float32[np.ndarray, "n features"]) -> Tensor:
        """Surroundings with mean 0 and spread 1 among the known ones, float32 [n, 13]."""
        return torch.from_numpy((values - self._mean) / self._spread)

    def __call__(self, rgb: UInt8[np.ndarray, "height width 3"]) -> Float32[np.ndarray, "height width"]:
        """Of each pixel of a picture: about 1 for what looks like the known, several times that for what does not."""
        return self.of(surroundings(rgb)).reshape(rgb.shape[:2])

    @torch.no_grad()
    def of(self, values: Float32[np.ndarray, "n features"]) -> Float32[np.ndarray, " n"]:
        """The same of some surroundings."""
        with one_torch_thread(1):
            nearest = [torch.cdist(part, self._known).amin(1) for part in self.scaled(values).split(1 << 16)]
        return (torch.cat(nearest) / self._usual).numpy()


def surroundings(rgb: UInt8[np.ndarray, "height width 3"]) -> Float32[np.ndarray, "pixels 13"]:
    """Of each pixel of a picture: CIELAB colour at three scales, contrast and edges at two, float32 [H · W, 13]."""
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    light = np.ascontiguousarray(lab[..., 0])
    maps = [channel for sigma in (0.7, 2, 5) for channel in cv2.split(cv2.GaussianBlur(lab, (0, 0), sigma))]
    for sigma in (1.5, 4):
        mean = cv2.GaussianBlur(light, (0, 0), sigma)
        maps.append(np.sqrt(np.maximum(cv2.GaussianBlur(light * light, (0, 0), sigma) - mean * mean, 0)))
    for sigma in (1, 2.5):
        smooth = cv2.GaussianBlur(light, (0, 0), sigma)
        maps.append(np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)))
    return np.stack(maps, -1).reshape(-1, len(maps))


def surroundings_by_class(
    rgb: UInt8[np.ndarray, "height width 3"], labels: np.ndarray, most: int, random: np.random.Generator
) -> dict[int, Float32[np.ndarray, "n 13"]]:
    """Surroundings of up to `most` pixels of each label of an int map [H, W], by label, negative ones left out."""
    around, flat, found = surroundings(rgb), labels.ravel(), {}
    for value in np.unique(flat[flat >= 0]).tolist():
        places = np.flatnonzero(flat == value)
        found[value] = around[random.choice(places, min(most, len(places)), replace=False)]
    return found
