"""One rendered frame, ready to be asked in words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from torch import Tensor

from degense.engine.clip import UNLABELLED
from degense.engine.raster import Render
from degense.engine.semantics.masks.decoders import DEFAULT_DECODER, DEFAULT_THRESHOLD, decode_labels, decode_mask, reads_regions
from degense.engine.semantics.masks.rnse import Aggregation
from degense.engine.semantics.masks.rnse_cpu import CpuAggregation
from degense.engine.semantics.masks.rnse_torch import TorchAggregation
from degense.engine.semantics.text.basis import Basis
from degense.engine.semantics.text.directions import unit_rows

#: Similarity maps kept per frame, one a text vector and kind: the classes of a session, so that a moved threshold computes none anew.
KEPT_MAPS = 32
#: A negative this close to the prompt is part of what is meant ("grasper" when the prompt is "tool") and does not compete with it.
INCLUDED = 0.6


@dataclass(frozen=True)
class Question:
    """A prompt in vectors.

    Attributes
    ----------
    meant : float [D] or [m, D]
        What is looked for; the best counts in each pixel.
    excluded : float [k, D] or None
        What the prompt says it does not mean.
    """

    meant: np.ndarray
    excluded: np.ndarray | None = None


@dataclass(frozen=True)
class Maps:
    """What decides about a mask: similarities float32 [H, W] with what is meant, the best rival, and the best that is excluded."""

    similarity: np.ndarray
    rivals: np.ndarray | None
    excluded: np.ndarray | None

    def mask(self, decoder: str, threshold: float) -> np.ndarray:
        """Pixels that are meant, bool [H, W]."""
        return decode_mask(self.similarity, self.rivals, decoder, threshold, self.excluded)


@dataclass(frozen=True)
class PendingMaps:
    """Similarities that may still lie on a GPU, where nothing has waited for them.

    Attributes
    ----------
    maps : list of lists of 3
        What becomes the `Maps` of each question; None for what it has not.
    numpy : callable
        `Aggregation.numpy`.
    """

    maps: list[list[Any]]
    numpy: Callable[[list[Any]], list[np.ndarray]]

    def read(self) -> list[Maps]:
        """Bring all into memory at once; in any thread, which alone waits."""
        arrays = iter(self.numpy([values for kinds in self.maps for values in kinds if values is not None]))
        read = [[None if values is None else next(arrays) for values in kinds] for kinds in self.maps]
        return [Maps(meant, rivals, excluded) for meant, rivals, excluded in read if meant is not None]


class FrameSemantics:
    """Answers prompts on one frame. Superpixels, normalised latents, filter statistics and similarity maps are computed once and kept.

    What is handed over as tensors stays on their device until a mask is read.
    Prompts are text vectors: [D], or [m, D] for a prompt that covers m classes; the best of them counts in each pixel.

    Parameters
    ----------
    rgb : uint8 [H, W, 3]
        The rendered colour: an array, or a tensor when the latent is one.
    latent : float32 [H, W, d]
        The rendered latent; zero and non-finite pixels have similarity 0.
    basis : Basis
        Of rank d.
    alpha : float32 [H, W], optional
        Rendered opacity; weighs the similarity.
    """

    def __init__(self, rgb: np.ndarray | Tensor, latent: np.ndarray | Tensor, basis: Basis, alpha: np.ndarray | Tensor | None = None):
        if rgb.ndim != 3 or rgb.shape[2] != 3 or str(rgb.dtype).rpartition(".")[2] != "uint8" or 0 in rgb.shape:
            raise ValueError(f"rgb must be uint8 [H, W, 3] and not empty, not {rgb.dtype} {tuple(rgb.shape)}")
        size = tuple(rgb.shape[:2])
        if tuple(latent.shape) != (*size, basis.rank):
            raise ValueError(f"latent must be {(*size, basis.rank)}, not {tuple(latent.shape)}")
        if alpha is not None and tuple(alpha.shape) != size:
            raise ValueError(f"alpha must be {size}, not {tuple(alpha.shape)}")
        self.basis = basis
        kind: type[Any] = TorchAggregation if isinstance(latent, Tensor) else CpuAggregation
        self._aggregation: Aggregation[Any] = kind(rgb, latent, alpha)
        self._maps: dict[tuple[bool, bytes], Any] = {}

    @property
    def superpixels(self) -> np.ndarray:
        """Regions of the rendered colour, int32 [H, W], 0 … K − 1."""
        return self._aggregation.regions

    def similarity(self, vectors: np.ndarray) -> np.ndarray:
        """Cosine with the prompt, pixelwise, float32 [H, W] in [−1, 1]."""
        return self._read(self._best(vectors, refined=False))

    def refined(self, vectors: np.ndarray) -> np.ndarray:
        """Region-aggregated, guided similarity (M_final, Eq. 4), float32 [H, W]; the guided filter may overshoot [−1, 1] a little."""
        return self._read(self._best(vectors, refined=True))

    def mask(
        self,
        vectors: np.ndarray,
        decoder: str = DEFAULT_DECODER,
        threshold: float = DEFAULT_THRESHOLD,
        negatives: np.ndarray | None = None,
        excluded: np.ndarray | None = None,
    ) -> np.ndarray:
        """Pixels the prompt means, bool [H, W].

        Parameters
        ----------
        vectors : float [D] or [m, D]
        decoder : str
            One of `decoders.DECODERS`.
        threshold : float
        negatives : float [n, D], optional
            Vectors of the session's classes; those that the prompt includes are left out. "threshold" does not use them.
        excluded : float [k, D], optional
            Vectors of what the prompt says it does not mean. Whatever the decoder, pixels that are more like one of these are left out.

        Raises
        ------
        ValueError
            For an unknown decoder or vectors of another length than the basis takes.
        """
        [mask] = self.masks([Question(vectors, excluded)], decoder, threshold, negatives)
        return mask

    def masks(
        self,
        questions: Sequence[Question],
        decoder: str = DEFAULT_DECODER,
        threshold: float = DEFAULT_THRESHOLD,
        negatives: np.ndarray | None = None,
    ) -> np.ndarray:
        """The mask of each question, bool [n, H, W], exactly as `mask` finds it alone; what is new of all is computed in one pass."""
        return np.stack([maps.mask(decoder, threshold) for maps in self.maps(questions, decoder, negatives)])

    def maps(self, questions: Sequence[Question], decoder: str = DEFAULT_DECODER, negatives: np.ndarray | None = None) -> list[Maps]:
        """What decides about each question's mask, in memory. `Maps.mask` may be called in any thread."""
        return self.pending(questions, decoder, negatives).read()

    def pending(self, questions: Sequence[Question], decoder: str = DEFAULT_DECODER, negatives: np.ndarray | None = None) -> PendingMaps:
        """`maps`, computed in one pass and still where they were computed."""
        refined = reads_regions(decoder)
        rivals = [None if decoder == "threshold" else self._rivals(question.meant, negatives) for question in questions]
        wanted = [(question.meant, others, question.excluded) for question, others in zip(questions, rivals, strict=True)]
        given = [[rows for rows in kinds if rows is not None and len(rows)] for kinds in wanted]
        self._found(np.concatenate([np.atleast_2d(rows) for kinds in given for rows in kinds]), refined)  # all that is new, at once
        best = [[None if rows is None or not len(rows) else self._best(rows, refined) for rows in kinds] for kinds in wanted]
        return PendingMaps(best, self._aggregation.numpy)

    def label_map(self, vectors: np.ndarray, decoder: str = DEFAULT_DECODER) -> np.ndarray:
        """Index of the best class in each pixel, uint8 [H, W], of class vectors [n, D], n ≤ 255; `UNLABELLED` where nothing is similar."""
        vectors = np.atleast_2d(vectors)
        if not 1 <= len(vectors) <= UNLABELLED:
            raise ValueError(f"a label map takes 1 to {UNLABELLED} classes, not {len(vectors)}")
        refined = reads_regions(decoder)
        return decode_labels(*self._aggregation.winners(self._found(vectors, refined)), decoder)

    def confidence(self, vectors: np.ndarray, mask: np.ndarray, negatives: np.ndarray | None = None) -> float:
        """How sure a mask is, in [0, 1]: mean refined similarity in it, less that of the best negative; 0 for an empty mask."""
        if not mask.any():
            return 0.0
        margin = self.refined(vectors)[mask]
        rivals = self._rivals(vectors, negatives)
        if rivals is not None:
            margin = margin - np.maximum(self.refined(rivals)[mask], 0.0)
        return float(np.clip(margin, 0.0, 1.0).mean())

    def _best(self, vectors: np.ndarray, refined: bool) -> Any:
        return self._aggregation.largest(self._found(np.atleast_2d(vectors), refined))

    def _found(self, vectors: np.ndarray, refined: bool) -> Sequence[Any]:
        """The maps of text vectors [n, D]. They are kept: callers share them, and only new ones are computed, all at once."""
        vectors = np.asarray(vectors, np.float32)
        keys = [(refined, vector.tobytes()) for vector in vectors]
        new = {key: vector for key, vector in zip(keys, vectors, strict=True) if key not in self._maps}
        found = {key: self._maps[key] for key in keys if key in self._maps}
        if new:
            rows = self.basis.project(unit_rows(np.stack(list(new.values()))))
            compute = self._aggregation.refined if refined else self._aggregation.similarity
            found |= zip(new, compute(rows), strict=True)
            self._maps |= {key: found[key] for key in new}
            while len(self._maps) > max(KEPT_MAPS, len(keys)):
                del self._maps[next(iter(self._maps))]
        return [found[key] for key in keys]

    def _rivals(self, vectors: np.ndarray, negatives: np.ndarray | None) -> np.ndarray | None:
        """Those of the negatives [n, D] that are no part of what is meant; None without any."""
        if negatives is None or len(negatives) == 0:
            return None
        prompt, others = (unit_rows(np.atleast_2d(rows).astype(np.float32)) for rows in (vectors, negatives))
        rivals = np.atleast_2d(negatives)[(others @ prompt.T).max(1) < INCLUDED]  # as given: the map of a class is found again
        return rivals if len(rivals) else None

    def _read(self, values: Any) -> np.ndarray:
        [array] = self._aggregation.numpy([values])
        return array


def query_of(drawn: Render, basis: Basis) -> FrameSemantics:
    """The query of a picture that was drawn with colours and latents [H, W, 3 + d]; from a GPU nothing is read back."""
    rgb = (drawn.image[..., :3].clamp(0, 1) * 255 + 0.5).byte()
    latent = drawn.image[..., 3:]
    if rgb.is_cuda:
        return FrameSemantics(rgb, latent, basis, drawn.alpha)
    return FrameSemantics(rgb.numpy(), latent.numpy(), basis, drawn.alpha.numpy())
