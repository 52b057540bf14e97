"""How a prompt is answered: how much it covers, how sure that is, how similar the pixels are; and why a pixel is what it is."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from degense.app.session.view_state import ViewState

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: Steps of a histogram of similarities from 0 to 1; what is smaller or larger falls into the first or last.
BINS = 50
#: Classes that explain a pixel.
BEST = 5


@dataclass(frozen=True)
class Answer:
    """What is known of a prompt in one frame.

    Attributes
    ----------
    area : float
        Share of the picture that the mask covers.
    confidence : float
        In [0, 1]: mean refined similarity in the mask, less that of the best rival class (`FrameSemantics.confidence`).
    histogram : int [BINS]
        Pixels by the similarity that the decoder compares with the threshold.
    """

    text: str
    area: float
    confidence: float
    histogram: np.ndarray


def answers(scene: Scene, frame: int, view_state: ViewState) -> Generator[tuple[Answer, ...], None, tuple[Answer, ...]]:
    """The answers of the visible prompts; yields those that are known."""
    from degense.engine.scene.clip_query import decode_frame
    from degense.engine.semantics.prompts import reads_regions

    query, prompts = scene.query(frame), view_state.prompt_set
    classes = scene.vectors((*scene.classes, *prompts.negatives))
    similarity = query.refined if reads_regions(prompts.decoder) else query.similarity
    known: tuple[Answer, ...] = ()
    for text in prompts.prompts:
        included = scene.included(text)
        [mask] = decode_frame(scene, replace(prompts, prompts=(text,)), frame).masks
        counts, _ = np.histogram(np.clip(similarity(included), 0.0, 1.0), BINS, (0.0, 1.0))
        known = (*known, Answer(text, float(mask.mean()), query.confidence(included, mask, classes), counts))
        yield known
    return known


class ClassDirections:
    """Every class of a scene and of its vocabulary, as directions of the latent."""

    def __init__(self, scene: Scene) -> None:
        assert scene.encoder is not None
        assert scene.basis is not None
        self.names = tuple(dict.fromkeys([*scene.classes, *scene.encoder.complete("")]))
        self._rows = scene.basis.project(scene.encoder.encode(list(self.names)))

    def best(self, latent: np.ndarray) -> list[tuple[str, float]]:
        """The classes most similar to a latent [d], with their cosines, the best first; none for a latent that says nothing."""
        length = float(np.linalg.norm(latent))
        if not length > 1e-6:
            return []
        cosines = self._rows @ (latent / length)
        return [(self.names[index], float(cosines[index])) for index in np.argsort(-cosines, kind="stable")[:BEST]]
