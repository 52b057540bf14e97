"""The teacher that runs a vision-language model: CLIP for features of its own space, CLIPSeg for the classes by their names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import torch

from degense.engine.clip import Clip
from degense.engine.errors import ClipError
from degense.engine.progress import Progress, silent
from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.models.mask_proposals import MaskProposals
from degense.engine.semantics.models.model_folder import find_model
from degense.engine.semantics.models.vlm_models import PLAIN, DenseModel, template_encoders, tiled
from degense.engine.semantics.teachers.target_cache import clip_settings
from degense.engine.semantics.teachers.teacher import Targets, enlarged, soft_targets
from degense.engine.semantics.text.encoder import EmbeddedEncoder, TextEncoder
from degense.engine.semantics.text.text_vectors import TextVectors
from degense.engine.vocabulary.concepts import surgical_vocabulary

REVISION = 1  # of the method: another one has other targets
MOST_SCALES = 6
LEAST_PROBABILITY = 0.3  # of CLIPSeg's best class; below it there is no target
UNNAMED = ("background", "black background", "background tissue", "background-tissue")  # no wording that a model could look for


class VlmTeacher:
    """Targets from a model on this machine, over tiles at one or more scales; on the GPU when there is one.

    With CLIP or SigLIP the run's encoder is a table of the model's own text vectors, of the clip's classes and of the surgical vocabulary,
    so the model is not needed for prompting. Its cosines are low (0.2 to 0.3 for a match): argmax decoders suit it, or a lower threshold.
    With CLIPSeg each class is looked for by its name, and the embedded encoder answers prompts.
    `place` is the folder of the model, or its name in the user's cache. `regions`, the folder of a SAM or its name there, lets each region
    that it proposes have the mean of what the model says in it; what no region holds keeps its patches. DegenseError when a model cannot be
    read, and for CLIPSeg when the clip names no classes.
    """

    def __init__(self, clip: Clip, place: str, scales: int = 1, regions: str = ""):
        if not 1 <= scales <= MOST_SCALES:
            raise ClipError(f"a frame is looked at in 1 to {MOST_SCALES} scales, not {scales}")
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.model = DenseModel(find_model(place), device)
        self.proposals = MaskProposals(find_model(regions), device) if regions else None
        options = [*([f"scales={scales}"] if scales > 1 else []), *([f"regions={regions}"] if regions else [])]
        self.name = f"vlm:{place}" + ("?" + "&".join(options) if options else "")
        self.pixelwise = bool(regions)
        self.frames = clip.train_frames
        self._clip, self._scales = clip, scales
        self._wordings = [name for name in clip.classes if name.casefold().replace("_", " ") not in UNNAMED]
        self.encoder: TextEncoder
        if self.model.has_text_vectors:
            self.encoder = _text_vectors(self.model, clip.classes)
        else:
            if not self._wordings:
                raise ClipError(f"Clip '{clip.name}' names no classes for CLIPSeg to look for; add classes.json beside its frames.")
            self.encoder = EmbeddedEncoder().with_classes(clip.classes)
            self._vectors = self.encoder.encode(self._wordings)
        self.provenance = f"{self.model.name} from {place}, {scales} scale{'s' if scales > 1 else ''}, encoder {self.encoder.name}"
        if self.proposals is not None:
            self.provenance += f", regions of {self.proposals.name} from {regions}"

    @property
    def settings(self) -> dict[str, Any]:
        """What the targets depend on."""
        return {
            **clip_settings(self._clip),
            "teacher": "vlm",
            "revision": REVISION,
            "model": self.model.name,
            "scales": self._scales,
            **({} if self.proposals is None else {"regions": self.proposals.name}),
            "prompt": PLAIN,
            "encoder": self.encoder.name,
            "versions": {name: version(name) for name in ("transformers", "torch", "opencv-contrib-python-headless")},
        }

    def compute(self, frames: Sequence[int], progress: Progress = silent) -> Iterator[tuple[int, Targets | None]]:
        """Targets of these frames, in order."""
        for done, frame in enumerate(frames):
            progress(done / len(frames), "running the vision-language model")
            yield frame, self._targets(frame)

    def _targets(self, frame: int) -> Targets | None:
        values = tiled(self._clip.frame(frame), self.model.side, self._scales, lambda tiles: self.model.maps(tiles, self._wordings))
        rows, columns, _ = values.shape
        place = enlarged(np.arange(rows * columns, dtype=np.int32).reshape(rows, columns), self._clip.size)
        flat = values.reshape(rows * columns, -1)
        pieces = unit_rows(flat) if self.model.has_text_vectors else 1 / (1 + np.exp(-flat.astype(np.float64)))
        if self.proposals is not None:
            pieces, place = by_regions(pieces, place, self.proposals(self._clip.frame(frame)))
        if self.model.has_text_vectors:
            vectors, index = unit_rows(pieces), place
        else:
            vectors, of_piece = soft_targets(pieces, self._vectors, pieces.max(-1) >= LEAST_PROBABILITY)
            index = of_piece[place]
        index = np.where(self._clip.valid(frame), index, -1).astype(np.int32)
        return (vectors.astype(np.float32), index) if (index >= 0).any() else None


def by_regions(pieces: np.ndarray, place: np.ndarray, masks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of pieces float [n, C] and the piece of each pixel int [H, W], with regions as further pieces: each has the mean over its
    pixels, and a pixel in several masks, bool [m, H, W], the largest first, is of the smallest."""
    region = np.full(place.shape, -1)
    for k, mask in enumerate(masks):
        region[mask] = k
    means = np.zeros((len(masks), pieces.shape[1]))
    for k in np.unique(region[region >= 0]):
        means[k] = np.bincount(place[region == k], minlength=len(pieces)) @ pieces / np.count_nonzero(region == k)
    return np.concatenate([pieces, means.astype(pieces.dtype)]), np.where(region >= 0, len(pieces) + region, place)


def _text_vectors(model: DenseModel, classes: Sequence[str]) -> TextEncoder:
    names = list(dict.fromkeys([*classes, *(concept.name for concept in surgical_vocabulary().concepts)]))
    encoder, embed = next(iter(template_encoders(model.name, model.texts).items()))
    vectors = embed([name.replace("_", " ") for name in names])
    return TextVectors(dict(zip(names, vectors, strict=True)), encoder).with_classes(classes)
