"""Sentences around a wording: a CLIP is trained on captions, and averaging over several removes what one of them adds."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence

import numpy as np

from degense.engine.semantics.basis import unit_rows

Embed = Callable[[Sequence[str]], np.ndarray]
#: The one of CLIPSeg, and of runs whose encoder's name has no digest of templates.
PLAIN = "a photo of a {}"
#: Names are things and stuff ("grasper", "fat"), so not all of these have an article. Other templates are another encoder.
TEMPLATES = (
    PLAIN,
    "a photo of {}",
    "a close-up photo of the {}",
    "a laparoscopic image of {}",
    "an endoscopic image of the {}",
    "{} seen through an endoscope",
    "{} during minimally invasive surgery",
    "a frame of a surgical video that shows the {}",
)


def template_encoders(model: str, embed: Embed) -> dict[str, Embed]:
    """Text encoders of a CLIP, words → unit vectors float [n, D], by name: in `TEMPLATES` first, then as earlier runs used it.

    A word has the normalised mean of its unit vectors in all templates, of which the name has a digest. `embed` turns sentences into
    vectors float [n, D] of any length but zero.
    """
    digest = hashlib.sha256("\n".join(TEMPLATES).encode()).hexdigest()[:8]
    return {f"{model}+templates-{digest}": _mean_over(TEMPLATES, embed), model: _mean_over((PLAIN,), embed)}


def _mean_over(templates: Sequence[str], embed: Embed) -> Embed:
    def encode(words: Sequence[str]) -> np.ndarray:
        vectors = unit_rows(embed([template.format(word) for word in words for template in templates]))
        return unit_rows(vectors.reshape(len(words), len(templates), -1).mean(1))

    return encode
