"""The ways to turn similarities into masks and label maps."""

from __future__ import annotations

import numpy as np

from degense.engine.clip import UNLABELLED
from degense.engine.semantics.masks.cleaning import without_holes, without_specks

#: threshold: pixelwise cosine above the threshold. argmax: pixelwise, the best of the session's classes.
#: rnse: region-aggregated, guided by the picture, and more like the prompt than like any other class, as far as the threshold says.
#: rnse+argmax: rnse that must beat the session's other classes, and little else.
DECODERS = ("threshold", "argmax", "rnse", "rnse+argmax")
DEFAULT_DECODER = "rnse"
#: With the embedded encoder a pixel of the class has a cosine near 1, a stranger near 0 and a sibling 0.35; a pixel that is half one class
#: and half another stands half way after averaging. On degraded label maps 0.4 to 0.6 cost `rnse` less than 0.05 IoU against the best.
DEFAULT_THRESHOLD = 0.5
#: But where the latent itself is a mixture, as on blended edges and where a teacher is unsure, half and half has a cosine of 0.7 with both.
#: There the two cosines tell the shares: at this threshold `rnse` asks for the larger one, at a lower or higher for less or more.
EVEN = 0.5


def reads_regions(decoder: str) -> bool:
    """Whether a decoder works on refined similarities. ValueError for an unknown decoder."""
    if decoder not in DECODERS:
        raise ValueError(f"unknown decoder '{decoder}'; allowed are {', '.join(DECODERS)}")
    return decoder.startswith("rnse")


def decode_mask(
    similarity: np.ndarray, rivals: np.ndarray | None, decoder: str, threshold: float, excluded: np.ndarray | None = None
) -> np.ndarray:
    """A mask, bool [H, W].

    Parameters
    ----------
    similarity : float32 [H, W]
        Refined for the rnse decoders, else pixelwise.
    rivals : float32 [H, W] or None
        The largest similarity with any other class of the session.
    decoder : str
    threshold : float
        A pixel must lie above it, and for rnse above threshold / `EVEN` times its best rival. For the argmax decoders, where the rivals
        do most of the work, above half of it: the generic negative "none of these".
    excluded : float32 [H, W] or None
        The largest similarity with anything that the prompt says it does not mean; it competes whatever the decoder.
    """
    competes = decoder.endswith("argmax")
    mask = similarity > (0.5 * threshold if competes else threshold)
    if rivals is not None and competes:
        mask &= similarity >= rivals
    elif rivals is not None and reads_regions(decoder):
        mask &= similarity > threshold / EVEN * rivals
    if excluded is not None:
        mask &= similarity > excluded  # what is excluded may be meant as well: "tool, not grasper"
        rivals = excluded if rivals is None else np.maximum(rivals, excluded)
    if not reads_regions(decoder) or not mask.any():
        return mask
    return without_holes(without_specks(mask), similarity, threshold, rivals)


def decode_labels(best: np.ndarray, similarity: np.ndarray, decoder: str) -> np.ndarray:
    """A label map, uint8 [H, W], of the best class, uint8 [H, W], and its similarity, float32 [H, W].

    `UNLABELLED` where no similarity is positive, and for "threshold" where none exceeds `DEFAULT_THRESHOLD`.
    """
    return np.where(similarity > (DEFAULT_THRESHOLD if decoder == "threshold" else 0.0), best, np.uint8(UNLABELLED))
