"""Region-aware similarity aggregation (Eq. 4 of the paper), applied only where the features are noisy.

The paper averages the cosine over each superpixel and filters the result with the frame as guide:

    S(R_k, T) = 1 / |R_k| Σ_{p ∈ R_k} ⟨F(p)/‖F(p)‖, v/‖v‖⟩        M_final = G(M_coarse, I_rgb)

The mean of cosines is the product with the mean of the normalised latents: means are taken once a frame, and a new prompt costs a product.
Averaging loses instruments thinner than a superpixel, and the filter those as pale as the tissue. Here four quantities in [0, 1] decide,
with z the normalised latents, ramp(x; a, b) = clip((x − a) / (b − a), 0, 1) and box_n the mean of n × n pixels:

    noisiness   λ = box_7(ramp(ν_k; 0.03, 0.1))     ν_k the noise of region k: geometric mean over it of the least, over four
                                                    directions e, of ‖z(p − 2e) − 2 z(p) + z(p + 2e)‖ / √6. A straight edge has none along
                                                    itself, and edges are few in a region: only noise counts.
    agreement   a = ramp(cos(z̃, M_k); 0.75, 0.9)    z̃ = z + λ (box_3 z − z); M_k the region's mean, pixels unlike its plain mean left out
    continuity  c = min(1, Σ_q ramp(cos(z̃(p), z̃(q)); 0.5, 0.8))    q on the square 9 pixels around p: instruments, however thin, and
                                                    edges go on that far; a speck does not
    speck       k = (1 − a) (1 − c)                 unlike its region and alone

    coarse(p) = w S(M_k) + (1 − w) s(p),   w = λ' a + k,   λ' = max(λ, min(1, 9 box_9 k))
    final(p) = coarse + g (G − coarse),    g = max(0.55, λ', ramp(R²; 0.6, 0.9)),   G the guided filter of coarse

The filter has a weight of at least 0.55, which removes faint false positives but not a thin instrument. R² is the share of the variance of
`coarse` that the colours explain around a pixel: edges that the frame shows are sharpened. Masks of exact latents do not change, noise is
averaged over regions, specks are removed, and an instrument one pixel wide remains. `means` is the paper's own M_final.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, TypeVar

import numpy as np

from degense.engine.semantics.prompts import Kind

#: Ramps: noise of a region; cosine with the region; cosine with a pixel further on; explained variance.
NOISE, AGREEMENT, ALIKE, EXPLAINED = (0.03, 0.1), (0.75, 0.9), (0.5, 0.8), (0.6, 0.9)
#: Cosine with the plain mean from which a pixel counts in the region's mean, and from which fully.
MAJORITY = (0.5, 0.9)
#: Pixels: stride of the second differences, distance at which a structure must go on, windows of noisiness and specks.
STRIDE, REACH, NOISE_WINDOW, SPECK_WINDOW = 2, 9, 7, 9
#: Noise below this is rounding; and how many times its share in the window a speck adds to the noisiness.
QUIET, SPECK_GAIN = 1e-3, 9.0
#: Guided filter: the variance of a colour in [0, 1] that counts as flat.
FLAT = 1e-3
#: The filter's least weight.
LEAST_GUIDED = 0.55
#: Variance of a similarity below which there is no edge to explain.
LEVEL = 1e-4

Map = TypeVar("Map")


class Aggregation(ABC, Generic[Map]):
    """One frame's normalised latents and regions, where they lie: in memory or on a GPU. Regions are found when first needed."""

    def __init__(self, rgb: Map | None):
        self._picture = rgb

    @property
    def _rgb(self) -> Map:
        if self._picture is None:
            raise ValueError("latents without a picture have no regions")
        return self._picture

    @property
    @abstractmethod
    def regions(self) -> np.ndarray:
        """Superpixels, int32 [H, W], 0 … K − 1."""

    @abstractmethod
    def similarity(self, vectors: np.ndarray) -> Map:
        """Pixelwise cosines, float32 [n, H, W], for rows q = Bᵀv / ‖v‖ [n, d]."""

    @abstractmethod
    def refined(self, vectors: np.ndarray) -> Map:
        """`final` above, float32 [n, H, W]; the guided filter may overshoot [−1, 1] a little."""

    @abstractmethod
    def means(self, vectors: np.ndarray) -> Map:
        """Eq. 4, float32 [n, H, W]: cosines, whatever the opacity, averaged over each superpixel, then guided by the picture."""

    def of_kind(self, kind: Kind, vectors: np.ndarray) -> Map:
        """The similarities that a decoder reads."""
        return {"pixel": self.similarity, "refined": self.refined, "mean": self.means}[kind](vectors)

    @abstractmethod
    def largest(self, maps: Sequence[Map]) -> Map:
        """The greatest of one or more maps in each pixel."""

    @abstractmethod
    def numpy(self, maps: Sequence[Map]) -> list[np.ndarray]:
        """Maps as read-only arrays in memory, all fetched at once."""
