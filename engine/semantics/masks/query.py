"""The latents of one rendered frame, or of all Gaussians, compared with prompts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
from torch import Tensor

from degense.engine.raster import Render
from degense.engine.semantics.basis import Basis, unit_rows
from degense.engine.semantics.masks.confidence import MARGINS_AS_CHANCES, ConfidenceCurve
from degense.engine.semantics.masks.decode import Decoded, Similarities, decode, owned
from degense.engine.semantics.masks.rnse import Aggregation
from degense.engine.semantics.masks.rnse_cpu import CpuAggregation
from degense.engine.semantics.masks.rnse_torch import TorchAggregation
from degense.engine.semantics.moments import mask_of
from degense.engine.semantics.prompts import Kind, PromptVectors, kind_of
from degense.engine.vocabulary.questions import heads

#: Similarity maps kept per frame, one a text vector and kind: the classes of a session, so that a moved threshold computes none anew.
KEPT_MAPS = 32
#: Decoders that do not compare a prompt with other classes.
WITHOUT_RIVALS = ("threshold", "rnse-paper")
#: A class this close to what a prompt covers is a part of it ("grasper" when the prompt is "tool") and does not compete with it.
INCLUDED = 0.6


@dataclass(frozen=True)
class PendingMasks:
    """Masks whose similarities may still lie on a GPU, where nothing has waited for them."""

    maps: list[list[Any]]  # each prompt's own, rivals' and excluded similarities; None for what it has not
    numpy: Callable[[list[Any]], list[np.ndarray]]  # `Aggregation.numpy`
    asked: PromptVectors
    regions: bool  # whether the similarities are refined
    least: float  # share of the picture, below which objects are left out
    known: Tensor | None = None  # bool [...]; where masks may be at all

    def read(self) -> Decoded:
        """Bring all similarities into memory at once and decode them; in any thread, which alone waits."""
        arrays = iter(self.numpy([values for kinds in self.maps for values in kinds if values is not None]))
        read = [[None if values is None else next(arrays) for values in kinds] for kinds in self.maps]
        similarities = [
            Similarities(own, rivals, excluded, len(np.atleast_2d(covered)))
            for (own, rivals, excluded), covered in zip(read, self.asked.included, strict=True)
            if own is not None
        ]
        found = decode(similarities, self.asked.decoder, self.asked.threshold, self.regions, self.least)
        if self.known is not None:
            found = owned(found.masks & self.known.cpu().numpy(), similarities)
        return _answers(self.asked, found, similarities) if self.asked.questions else found


def _answers(asked: PromptVectors, found: Decoded, of_nouns: Sequence[Similarities]) -> Decoded:
    """The masks of questions, from those of their nouns; each is as similar and as broad as the nouns whose pixels it holds."""
    masks, by_text = dict(zip(asked.nouns, found.masks, strict=True)), dict(zip(asked.nouns, of_nouns, strict=True))
    similarities = [
        Similarities(
            np.maximum.reduce([by_text[text].own for text in heads(question)]), breadth=sum(by_text[t].breadth for t in heads(question))
        )
        for question in asked.questions
    ]
    return owned(np.stack([mask_of(question, masks) for question in asked.questions]), similarities)


class FrameSemantics:
    """Answers prompts on one frame. Superpixels, normalised latents, filter statistics and similarity maps are computed once and kept.

    What is handed over as tensors stays on their device until a mask is read.

    Rendered are the colour uint8 [H, W, 3], the latent float32 [H, W, d], d the rank of the basis, whose zero and non-finite pixels have
    similarity 0, and the opacity `alpha` float32 [H, W], which weighs the similarity. Colours are None for latents that are no picture,
    such as those of Gaussians; all decoders then work element by element. `curve` tells chances from margins, as the run has it. Where
    `known`, bool [H, W], is False, nobody said what is there: no mask holds it, and the chance of a name to be right is 0.
    """

    def __init__(
        self,
        rgb: np.ndarray | Tensor | None,
        latent: np.ndarray | Tensor,
        basis: Basis,
        alpha: np.ndarray | Tensor | None = None,
        curve: ConfidenceCurve = MARGINS_AS_CHANCES,
        known: Tensor | None = None,
    ):
        if rgb is not None and (rgb.ndim != 3 or rgb.shape[2] != 3 or str(rgb.dtype).rpartition(".")[2] != "uint8" or 0 in rgb.shape):
            raise ValueError(f"rgb must be uint8 [H, W, 3] and not empty, not {rgb.dtype} {tuple(rgb.shape)}")
        size = tuple((latent if rgb is None else rgb).shape[:2])
        if tuple(latent.shape) != (*size, basis.rank):
            raise ValueError(f"latent must be {(*size, basis.rank)}, not {tuple(latent.shape)}")
        if alpha is not None and tuple(alpha.shape) != size:
            raise ValueError(f"alpha must be {size}, not {tuple(alpha.shape)}")
        if known is not None and tuple(known.shape) != size:
            raise ValueError(f"known must be {size}, not {tuple(known.shape)}")
        self.basis, self.curve, self.known = basis, curve, known
        kind: type[Any] = TorchAggregation if isinstance(latent, Tensor) else CpuAggregation
        self._aggregation: Aggregation[Any] = kind(rgb, latent, alpha)
        self._has_picture = rgb is not None
        self._maps: dict[tuple[Kind, bytes], Any] = {}

    def similarity(self, vectors: np.ndarray) -> np.ndarray:
        """Cosine with the prompt, pixelwise, float32 [H, W] in [−1, 1]."""
        return self.read(vectors, "pixel")

    def refined(self, vectors: np.ndarray) -> np.ndarray:
        """Region-aggregated, guided similarity, float32 [H, W]; the guided filter may overshoot [−1, 1] a little."""
        return self.read(vectors, "refined")

    def read(self, vectors: np.ndarray, kind: Kind) -> np.ndarray:
        """Similarity with the prompt of the kind that a decoder reads (`kind_of`), float32 [H, W]."""
        [array] = self._aggregation.numpy([self._best(vectors, kind)])
        return array

    def decode(self, asked: PromptVectors, pixelwise: bool = False) -> Decoded:
        """Masks [n, H, W] and labels [H, W]; what is new of all prompts is computed in one pass.

        `pixelwise` leaves out regions and cleaning: a preview that needs no superpixels. ValueError for vectors of another length than the
        basis takes.
        """
        return self.pending(asked, pixelwise).read()

    def pending(self, asked: PromptVectors, pixelwise: bool = False) -> PendingMasks:
        """`decode`, with similarities computed in one pass and still where they were computed."""
        kind = kind_of(asked.decoder) if self._has_picture and not pixelwise else "pixel"
        prompts = [
            (included, self._rivals(included, asked.classes) if asked.decoder not in WITHOUT_RIVALS else None, excluded)
            for included, excluded in zip_longest(asked.included, asked.excluded)
        ]
        wanted = [[None if rows is None or not len(rows) else np.atleast_2d(rows) for rows in kinds] for kinds in prompts]
        self._found(np.concatenate([rows for kinds in wanted for rows in kinds if rows is not None]), kind)  # all that is new, at once
        best = [[None if rows is None else self._best(rows, kind) for rows in kinds] for kinds in wanted]
        return PendingMasks(best, self._aggregation.numpy, asked, kind == "refined", self.curve.least, self.known)

    def confidence(self, vectors: np.ndarray, mask: np.ndarray, classes: np.ndarray | None = None) -> float:
        """The share of a mask bool [H, W] that is expected to be right, in [0, 1], by the `chances` of its pixels and the sizes of its
        objects; 0 for an empty mask."""
        return self.curve.of_mask(self.chances(vectors, classes), mask)

    def chances(self, vectors: np.ndarray, classes: np.ndarray | None = None) -> np.ndarray:
        """The chance of each pixel, if a mask of the prompt holds it, to be right, float32 [H, W]; `classes` [n, D] are its rivals."""
        chances = self.curve(self.margin(vectors, classes))
        return chances if self.known is None else chances * self.known.cpu().numpy()

    def margin(self, vectors: np.ndarray, classes: np.ndarray | None = None) -> np.ndarray:
        """Refined similarity with the prompt, less that with the best other class [n, D], float32 [H, W] in [0, 1]."""
        own, rivals = self.refined(vectors), self._rivals(vectors, classes)
        return np.clip(own if rivals is None else own - np.maximum(self.refined(rivals), 0.0), 0.0, 1.0)

    def _best(self, vectors: np.ndarray, kind: Kind) -> Any:
        return self._aggregation.largest(self._found(np.atleast_2d(vectors), kind))

    def _found(self, vectors: np.ndarray, kind: Kind) -> Sequence[Any]:
        """The maps of text vectors [n, D]. They are kept: callers share them, and only new ones are computed, all at once."""
        vectors = np.asarray(vectors, np.float32)
        keys = [(kind, vector.tobytes()) for vector in vectors]
        new = {key: vector for key, vector in zip(keys, vectors, strict=True) if key not in self._maps}
        found = {key: self._maps[key] for key in keys if key in self._maps}
        if new:
            rows = self.basis.project(unit_rows(np.stack(list(new.values()))))
            found |= zip(new, self._aggregation.of_kind(kind, rows), strict=True)
            self._maps |= {key: found[key] for key in new}
            while len(self._maps) > max(KEPT_MAPS, len(keys)):
                del self._maps[next(iter(self._maps))]
        return [found[key] for key in keys]

    def _rivals(self, vectors: np.ndarray, classes: np.ndarray | None) -> np.ndarray | None:
        """Those of the classes [n, D] that the prompt does not cover; None without any."""
        if classes is None or len(classes) == 0:
            return None
        prompt, others = (unit_rows(np.atleast_2d(rows).astype(np.float32)) for rows in (vectors, classes))
        rivals = np.atleast_2d(classes)[(others @ prompt.T).max(1) < INCLUDED]  # as given: the map of a class is found again
        return rivals if len(rivals) else None


def query_of(drawn: Render, basis: Basis, curve: ConfidenceCurve = MARGINS_AS_CHANCES, known: Tensor | None = None) -> FrameSemantics:
    """The semantics of a frame drawn with colours and latents [H, W, 3 + d], `known` as `FrameSemantics` has it; from a GPU nothing is
    read back."""
    rgb = (drawn.image[..., :3].clamp(0, 1) * 255 + 0.5).byte()
    latent = drawn.image[..., 3:]
    if rgb.is_cuda:
        return FrameSemantics(rgb, latent, basis, drawn.alpha, curve, known)
    return FrameSemantics(rgb.numpy(), latent.numpy(), basis, drawn.alpha.numpy(), curve, known)
