"""The sentences in which a CLIP is asked for words: it learnt from captions, and what one of them adds of its own averages out."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence

import numpy as np

from degense.engine.semantics.basis import unit_rows

Embed = Callable[[Sequence[str]], np.ndarray]
#: CLIPSeg is asked in this one, and runs whose encoder's name says nothing of templates were made with it alone.
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


def asked_in_templates(model: str, embed: Embed) -> dict[str, Embed]:
    """The ways to ask a CLIP for words, by the name of the encoder that asks so: in `TEMPLATES` first, then as earlier runs did.

    Parameters
    ----------
    model : str
        Name of the model.
    embed : callable
        Sentences → vectors float [n, D], of any length but zero.

    Returns
    -------
    dict of str to callable
        Words → unit vectors float [n, D]: the normalised mean of a word's unit vectors in all templates, of which the name has a digest.
    """
    digest = hashlib.sha256("\n".join(TEMPLATES).encode()).hexdigest()[:8]
    return {f"{model}+templates-{digest}": _mean_over(TEMPLATES, embed), model: _mean_over((PLAIN,), embed)}


def _mean_over(templates: Sequence[str], embed: Embed) -> Embed:
    def asked(words: Sequence[str]) -> np.ndarray:
        vectors = unit_rows(embed([template.format(word) for word in words for template in templates]))
        return unit_rows(vectors.reshape(len(words), len(templates), -1).mean(1))

    return asked
