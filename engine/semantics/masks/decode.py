"""The one rule that turns similarities into masks: of pixels or of Gaussians, for one prompt or several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

import degense.engine.threads  # noqa: F401 - where compiled kernels are kept
from degense.engine.clip import UNLABELLED
from degense.engine.semantics.masks.cleaning import without_holes, without_specks

#: Where a latent is a mixture, as on blended edges and where a teacher is unsure, half and half has a cosine of 0.7 with both classes.
#: There the two cosines tell the shares: at this threshold `rnse` asks for the larger one, at a lower or higher for less or more.
EVEN = 0.5


@dataclass(frozen=True)
class Similarities:
    """What decides about the mask of one prompt: the largest similarities, float32 [...] each."""

    own: np.ndarray  # with a class that the prompt covers
    rivals: np.ndarray | None = None  # with any other class of the session
    excluded: np.ndarray | None = None  # with anything that the prompt, or a negative, excludes
    breadth: int = 1  # how many classes the prompt covers


@dataclass(frozen=True)
class Decoded:
    """The masks of some prompts."""

    masks: np.ndarray  # bool [n, ...]; one for each prompt; they may overlap
    labels: np.ndarray  # uint8 [...]; index of the prompt that owns the element, of those whose masks hold it; else `UNLABELLED`

    @property
    def numbers(self) -> np.ndarray:
        """uint8 [...]: k + 1 where prompt k owns the element, 0 where no mask holds it."""
        return self.labels + np.uint8(1)  # of `UNLABELLED`, 255, that is 0

    @property
    def areas(self) -> np.ndarray:
        """Share of the picture that each mask covers, float64 [n]."""
        return self.masks.reshape(len(self.masks), -1).mean(1)


def decode(similarities: Sequence[Similarities], decoder: str, threshold: float, regions: bool = False, least: float = 0.0) -> Decoded:
    """Masks and owners.

    The mask of a prompt holds an element whose similarity s exceeds everything that the decoder compares it with: the threshold τ (half of
    it for the argmax decoders, where the other classes decide), the other classes' similarity r (s ≥ r for argmax, s > τ / `EVEN` · r for
    rnse, no comparison for the others), and, whatever the decoder, that of what is excluded. Prompts take nothing from each other's masks.
    The owner of an element is the most similar prompt; of equally similar ones the one that covers fewer classes, then the first.
    At most 255 prompts, of one shape. Of `regions`, refined similarities of a picture [H, W], masks lose specks, objects that cover less
    than the share `least` of the picture, and small holes.
    """
    return owned(np.stack([_mask(of_prompt, decoder, threshold, regions, least) for of_prompt in similarities]), similarities)


def owned(masks: np.ndarray, similarities: Sequence[Similarities]) -> Decoded:
    """Masks bool [n, ...] with the owner of each element, as in `decode`."""
    labels = np.full(masks.shape[1:], UNLABELLED, np.uint8)
    highest = np.full(masks.shape[1:], -np.inf, np.float32)
    for index in sorted(range(len(masks)), key=lambda k: similarities[k].breadth):  # stable: the first of equally narrow ones
        _own(masks[index].reshape(-1), similarities[index].own.reshape(-1), index, labels.reshape(-1), highest.reshape(-1))
    return Decoded(masks, labels)


def _mask(of_prompt: Similarities, decoder: str, threshold: float, regions: bool, least: float) -> np.ndarray:
    own, rivals, excluded = of_prompt.own, of_prompt.rivals, of_prompt.excluded
    competes = decoder.endswith("argmax")
    mask = own > (0.5 * threshold if competes else threshold)
    if rivals is not None and competes:
        mask &= own >= rivals
    elif rivals is not None and decoder == "rnse":
        mask &= own > threshold / EVEN * rivals
    if excluded is not None:
        mask &= own > excluded  # what is excluded may be included as well: "tool", with the negative "grasper"
        rivals = excluded if rivals is None else np.maximum(rivals, excluded)
    if not regions or not mask.any():
        return mask
    return without_holes(without_specks(mask, least), own, threshold, rivals)


@njit(nogil=True, cache=True)
def _own(mask, similarity, index, labels, highest):
    """Give the elements of a mask to a prompt, in place, where no prompt before it is as similar."""
    for i in range(mask.size):
        if mask[i] and similarity[i] > highest[i]:
            labels[i], highest[i] = index, similarity[i]
