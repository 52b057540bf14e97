"""Region-aware similarity aggregation (Eq. 4 of the paper) with regions that give way where the features are sure.

The paper averages the cosine over each superpixel and filters the result under the guidance of the picture:

    S(R_k, T) = 1 / |R_k| Σ_{p ∈ R_k} ⟨F(p)/‖F(p)‖, v/‖v‖⟩        M_final = G(M_coarse, I_rgb)

The mean of cosines is the product with the mean of the normalised latents: means are taken once a frame, and a new prompt costs a product.
Averaging loses instruments thinner than a superpixel. Here a pixel keeps its own similarity where its neighbourhood disagrees with the
region: with m the 3 × 3 mean of the normalised latents and M_k the region's mean,

    w(p) = clip((cos(m(p), M_k) − 0.75) / 0.15, 0, 1)        coarse(p) = w S(R_k) + (1 − w) s(p)

A lone wrong pixel is outvoted in its own 3 × 3 (w = 1: cleaned), an instrument three pixels wide is not (w = 0: kept).
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit, prange

from engine.masks.similarity import cosine
from engine.masks.superpixels import superpixels
from engine.threads import KERNEL_LOCK

#: Cosine of neighbourhood and region below which the pixel is trusted, and above which the region is.
TRUST_PIXEL, TRUST_REGION = 0.75, 0.9
#: Guided filter: window radius in pixels, and the variance of a colour in [0, 1] that counts as flat.
RADIUS, FLAT = 3, 1e-3


class RegionAggregation:
    """What region aggregation needs of one frame, computed once.

    Parameters
    ----------
    rgb : uint8 [H, W, 3]
    unit : float32 [H, W, d]
        Normalised latents.

    Attributes
    ----------
    regions : int32 [H, W]
        Superpixels, 0 … K − 1.
    means : float32 [K, d]
        Mean normalised latent of each.
    trust : float32 [H, W]
        w above: 1 where the region speaks, 0 where the pixel does.
    """

    def __init__(self, rgb: np.ndarray, unit: np.ndarray):
        self._unit = unit
        self.regions = superpixels(rgb)
        count = int(self.regions.max()) + 1
        local = cv2.blur(unit, (3, 3), borderType=cv2.BORDER_REPLICATE).reshape(unit.shape)
        with KERNEL_LOCK:
            self.means = _means(unit, self.regions, count)
            self.trust = _trust(local, self.regions, self.means)
        # OpenCV 5 gives up on nearly singular windows of a float guide in [0, 1] (thin structures vanish); with bytes it is exact
        self._filter = cv2.ximgproc.createGuidedFilter(np.ascontiguousarray(rgb), RADIUS, FLAT * 255.0**2)

    def coarse(self, vector: np.ndarray) -> np.ndarray:
        """M_coarse, float32 [H, W], for q = Bᵀv / ‖v‖ [d]."""
        pixel = cosine(self._unit, vector)
        with KERNEL_LOCK:
            return _blend(pixel, self.regions, self.means @ vector.astype(np.float32), self.trust)

    def refined(self, vector: np.ndarray) -> np.ndarray:
        """M_final, float32 [H, W], for q = Bᵀv / ‖v‖ [d]."""
        return self._filter.filter(self.coarse(vector)).reshape(self.regions.shape)


@njit(cache=True)
def _means(unit, regions, count):
    sums = np.zeros((count, unit.shape[2]), np.float64)
    sizes = np.zeros(count, np.float64)
    for y in range(unit.shape[0]):
        for x in range(unit.shape[1]):
            k = regions[y, x]
            sizes[k] += 1.0
            for c in range(unit.shape[2]):
                sums[k, c] += unit[y, x, c]
    for k in range(count):
        for c in range(unit.shape[2]):
            sums[k, c] /= sizes[k]
    return sums.astype(np.float32)


@njit(parallel=True, cache=True)
def _trust(local, regions, means):
    height, width, channels = local.shape
    out = np.empty((height, width), np.float32)
    for y in prange(height):
        for x in range(width):
            product, own, region = 0.0, 0.0, 0.0
            for c in range(channels):
                a, b = local[y, x, c], means[regions[y, x], c]
                product += a * b
                own += a * a
                region += b * b
            length = np.sqrt(own * region)
            agreement = product / length if length > 1e-12 else 1.0
            out[y, x] = min(max((agreement - TRUST_PIXEL) / (TRUST_REGION - TRUST_PIXEL), 0.0), 1.0)
    return out


@njit(parallel=True, cache=True)
def _blend(pixel, regions, means, trust):
    out = np.empty(pixel.shape, np.float32)
    for y in prange(pixel.shape[0]):
        for x in range(pixel.shape[1]):
            w = trust[y, x]
            out[y, x] = w * means[regions[y, x]] + (np.float32(1.0) - w) * pixel[y, x]
    return out
