"""One rendered frame, ready to be asked in words."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from engine.clip import UNLABELLED
from engine.language.basis import Basis
from engine.masks.decoders import DEFAULT_DECODER, DEFAULT_THRESHOLD, decode_labels, decode_mask, reads_regions
from engine.masks.rnse import RegionAggregation
from engine.masks.similarity import cosine, normalised

#: Similarity maps kept per frame, one a text vector and kind: the classes of a session, so that a moved threshold computes none anew.
KEPT_MAPS = 32
#: A negative this close to the prompt is part of what is meant ("grasper" when the prompt is "tool") and does not compete with it.
INCLUDED = 0.6


class MaskQuery:
    """Answers prompts on one frame. Superpixels, normalised latents, filter statistics and similarity maps are computed once and kept.

    Prompts are text vectors: [D], or [m, D] for a prompt that covers m classes; the best of them counts in each pixel.

    Parameters
    ----------
    rgb : uint8 [H, W, 3]
        The rendered colour.
    latent : float32 [H, W, d]
        The rendered latent; zero and non-finite pixels have similarity 0.
    basis : Basis
        Of rank d.
    alpha : float32 [H, W], optional
        Rendered opacity; weighs the similarity.
    """

    def __init__(self, rgb: np.ndarray, latent: np.ndarray, basis: Basis, alpha: np.ndarray | None = None):
        if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8 or rgb.size == 0:
            raise ValueError(f"rgb must be uint8 [H, W, 3] and not empty, not {rgb.dtype} {rgb.shape}")
        if latent.shape != (*rgb.shape[:2], basis.rank):
            raise ValueError(f"latent must be {(*rgb.shape[:2], basis.rank)}, not {latent.shape}")
        if alpha is not None and alpha.shape != rgb.shape[:2]:
            raise ValueError(f"alpha must be {rgb.shape[:2]}, not {alpha.shape}")
        self.basis = basis
        self._rgb = rgb
        self._unit = normalised(latent, alpha)
        self._maps: dict[tuple[bool, bytes], np.ndarray] = {}

    @property
    def superpixels(self) -> np.ndarray:
        """Regions of the rendered colour, int32 [H, W], 0 … K − 1."""
        return self._aggregation.regions

    def similarity(self, vectors: np.ndarray) -> np.ndarray:
        """Cosine with the prompt, pixelwise, float32 [H, W] in [−1, 1]."""
        return self._best(vectors, refined=False)

    def refined(self, vectors: np.ndarray) -> np.ndarray:
        """Region-aggregated, guided similarity (M_final, Eq. 4), float32 [H, W]; the guided filter may overshoot [−1, 1] a little."""
        return self._best(vectors, refined=True)

    def mask(
        self,
        vectors: np.ndarray,
        decoder: str = DEFAULT_DECODER,
        threshold: float = DEFAULT_THRESHOLD,
        negatives: np.ndarray | None = None,
    ) -> np.ndarray:
        """Pixels the prompt means, bool [H, W].

        Parameters
        ----------
        vectors : float [D] or [m, D]
        decoder : str
            One of `decoders.DECODERS`.
        threshold : float
        negatives : float [n, D], optional
            Vectors of the session's classes; those that the prompt includes are left out.
            Used by the argmax decoders and when holes are closed.

        Raises
        ------
        ValueError
            For an unknown decoder or vectors of another length than the basis takes.
        """
        refined = reads_regions(decoder)
        rivals = None if decoder == "threshold" else self._rivals(vectors, negatives, refined)
        return decode_mask(self._best(vectors, refined), rivals, decoder, threshold)

    def label_map(self, vectors: np.ndarray, decoder: str = DEFAULT_DECODER) -> np.ndarray:
        """Index of the best class in each pixel, uint8 [H, W], of class vectors [n, D], n ≤ 255; `UNLABELLED` where nothing is similar."""
        vectors = np.atleast_2d(vectors)
        if not 1 <= len(vectors) <= UNLABELLED:
            raise ValueError(f"a label map takes 1 to {UNLABELLED} classes, not {len(vectors)}")
        refined = reads_regions(decoder)
        return decode_labels(np.stack([self._map(vector, refined) for vector in vectors]), decoder)

    def confidence(self, vectors: np.ndarray, mask: np.ndarray, negatives: np.ndarray | None = None) -> float:
        """How sure a mask is, in [0, 1]: mean refined similarity in it, less that of the best negative; 0 for an empty mask."""
        if not mask.any():
            return 0.0
        margin = self.refined(vectors)[mask]
        rivals = self._rivals(vectors, negatives, refined=True)
        if rivals is not None:
            margin = margin - np.maximum(rivals[mask], 0.0)
        return float(np.clip(margin, 0.0, 1.0).mean())

    @cached_property
    def _aggregation(self) -> RegionAggregation:
        return RegionAggregation(self._rgb, self._unit)

    def _best(self, vectors: np.ndarray, refined: bool) -> np.ndarray:
        maps = [self._map(vector, refined) for vector in np.atleast_2d(vectors)]
        return maps[0] if len(maps) == 1 else np.maximum.reduce(maps)

    def _map(self, vector: np.ndarray, refined: bool) -> np.ndarray:
        """The kept map of one text vector. Maps are read-only: callers share them."""
        vector = np.asarray(vector, np.float32)
        key = refined, vector.tobytes()
        if (found := self._maps.get(key)) is None:
            projected = self.basis.project(vector) / max(float(np.linalg.norm(vector)), 1e-12)
            found = self._aggregation.refined(projected) if refined else cosine(self._unit, projected)
            found.flags.writeable = False
            self._maps[key] = found
            while len(self._maps) > KEPT_MAPS:
                del self._maps[next(iter(self._maps))]
        return found

    def _rivals(self, vectors: np.ndarray, negatives: np.ndarray | None, refined: bool) -> np.ndarray | None:
        if negatives is None or len(negatives) == 0:
            return None
        prompt, others = (_unit_rows(np.atleast_2d(rows)) for rows in (vectors, negatives))
        rivals = others[(others @ prompt.T).max(1) < INCLUDED]
        return self._best(rivals, refined) if len(rivals) else None


def _unit_rows(rows: np.ndarray) -> np.ndarray:
    return np.asarray(rows, np.float32) / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)
