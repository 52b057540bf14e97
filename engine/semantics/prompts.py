"""What is asked of a scene: texts, and how similarities become masks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from degense.engine.clip import UNLABELLED
from degense.engine.errors import PromptError
from degense.engine.vocabulary.questions import Expression

#: threshold: similarity above the threshold. argmax: also at least as high as that of every class that the prompt does not include.
#: rnse: on region-aggregated, guided similarities; above the threshold, and above threshold / EVEN times the best other class.
#: rnse+argmax: argmax on region-aggregated, guided similarities.
#: rnse-paper: as the paper has it; above the threshold, on means over superpixels, guided (Eq. 4). Classes do not compete.
DECODERS = ("threshold", "argmax", "rnse", "rnse+argmax", "rnse-paper")
#: Similarities that a decoder reads where there is a picture: of each pixel, region-aggregated (`engine.semantics.masks.rnse`), or Eq. 4's.
Kind = Literal["pixel", "refined", "mean"]
DEFAULT_DECODER = "rnse"
#: With the embedded encoder a pixel of the class has a cosine near 1, one of an unrelated class near 0, one of a class of the same kind
#: 0.35; a pixel that is half one class and half another lies half way after averaging. On degraded label maps 0.4 to 0.6 cost `rnse` less
#: than 0.05 IoU against the best.
DEFAULT_THRESHOLD = 0.5


@dataclass(frozen=True)
class PromptSet:
    """Prompts, and how they are decoded: the same value for the window, the command line, exports and scores.

    PromptError for too many prompts, an unknown decoder or a threshold that is not finite.
    """

    prompts: tuple[str, ...] = ()  # at most 255; each has a mask of its own, and masks may overlap
    negatives: tuple[str, ...] = ()  # texts that take pixels from the masks of all prompts
    decoder: str = DEFAULT_DECODER  # one of `DECODERS`
    threshold: float = DEFAULT_THRESHOLD  # on the cosine

    def __post_init__(self) -> None:
        if len(self.prompts) > UNLABELLED:
            raise PromptError(f"A scene is asked for at most {UNLABELLED} prompts at once, not {len(self.prompts)}.")
        if self.decoder not in DECODERS:
            raise PromptError(f"There is no decoder {self.decoder!r}; choose one of {', '.join(DECODERS)}.")
        if not math.isfinite(self.threshold):
            raise PromptError(f"The threshold must be a number, not {self.threshold}.")

    @classmethod
    def chosen(cls, prompts: Sequence[str], decoder: str | None = None, threshold: float | None = None) -> PromptSet:
        """Of the command line, where None stands for the default."""
        return cls(tuple(prompts), (), decoder or DEFAULT_DECODER, DEFAULT_THRESHOLD if threshold is None else threshold)


#: Asks nothing.
NO_PROMPTS = PromptSet()


@dataclass(frozen=True)
class PromptVectors:
    """A `PromptSet` in text vectors of length D: of its prompts, or of the nouns of its questions."""

    #: For each prompt or noun the classes that it covers, float [m, D] or [D]; the most similar one counts in each pixel.
    included: tuple[np.ndarray, ...]
    #: For each what it excludes, negatives among them, float [k, D]; empty when none excludes anything.
    excluded: tuple[np.ndarray, ...] = ()
    classes: np.ndarray | None = None  # float [n, D]; the session's. Those that a prompt includes do not compete with it
    decoder: str = DEFAULT_DECODER
    threshold: float = DEFAULT_THRESHOLD
    nouns: tuple[str, ...] = ()  # where prompts are questions, the texts of `included`
    questions: tuple[Expression, ...] = ()  # and the prompts, which masks of nouns answer


def kind_of(decoder: str) -> Kind:
    """Which similarities a decoder reads."""
    return "mean" if decoder == "rnse-paper" else "refined" if decoder.startswith("rnse") else "pixel"
