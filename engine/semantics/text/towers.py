"""Text towers of models on this machine: of a CLIP, in whose space its features lie, and of sentence embeddings, a space for labels."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from degense.engine.errors import DegenseError
from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.models.model_folder import MOST_BYTES, find_model, model_config, model_digest, saved_by_transformers
from degense.engine.semantics.models.tokens import tokenized
from degense.engine.semantics.models.vlm_models import DenseModel, Embed, template_encoders
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.semantics.text.text_vectors import TextVectors
from degense.engine.untrusted import read_json
from degense.engine.vocabulary.concepts import surgical_vocabulary

QUOTED = re.compile(r"\s*[\"“„«](.+)[\"“”»]\s*")
#: What sentence-transformers may put one after the other, and we know how to.
MODULES = ("Transformer", "Pooling", "Normalize")
BATCH = 32


class TextTower(TextEncoder):
    """A model's vectors of the session's classes, of the vocabulary's concepts and, in quotes, of anything.

    A wording is replaced by the name of its class or concept, so synonyms, misspellings and other languages work with a model that knows
    none of them. A word that is not understood is an error: a model has a vector for nonsense, too. A text in quotes is encoded as it is.
    `encoders` turn texts into unit vectors float [n, D], by the encoder's name, digest of the model included. The first is this encoder,
    the others are the same model with the templates of earlier runs.
    """

    def __init__(self, encoders: Mapping[str, Embed], classes: Sequence[str] = ()):
        super().__init__(classes)
        self._encoders = encoders
        self.name, self._embed = next(iter(encoders.items()))
        self._known: dict[str, np.ndarray] = {}
        self.dimension = len(self._vector("tissue"))

    def with_classes(self, classes: Sequence[str]) -> TextTower:
        return TextTower(self._encoders, classes)

    def for_run(self, name: str) -> TextTower | None:
        return TextTower({name: self._encoders[name], **self._encoders}, self.classes) if name in self._encoders else None

    def _vector(self, wording: str) -> np.ndarray:
        if wording not in self._known:
            [self._known[wording]] = self._embed([wording])
        return self._known[wording]

    def _of_class(self, name: str) -> np.ndarray:
        return self._vector(name.replace("_", " "))

    def _of_concept(self, concept: str) -> dict[str, np.ndarray]:
        return {concept: self._vector(concept)}

    def _read(self, text: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        return (self._found(text), {}) if QUOTED.fullmatch(text) else super()._read(text)

    def _found(self, text: str) -> dict[str, np.ndarray]:
        if quoted := QUOTED.fullmatch(text):
            return {text: self._vector(quoted.group(1))}
        return super()._found(text)


class SentenceModel:
    """A model of sentence embeddings as sentence-transformers saves it: a transformer, pooling, nothing else that changes a vector.

    Vectors are taken from their mean over the vocabulary: all wordings share a direction that carries no information, and
    without it names of different things lie far apart. DegenseError when transformers is missing, or the folder holds no such model.
    """

    def __init__(self, folder: Path):
        model_config(folder)
        self._pooling = _pooling(folder)
        model, self._tokenizer = saved_by_transformers(folder, "sentence model", "AutoModel")
        self._model = model.eval().requires_grad_(False)
        self.name = f"sentence-{model_digest(folder)}"
        self._mean = 0.0
        # concepts that were added later leave the space as it is
        self._mean = self._pooled([concept.name for concept in surgical_vocabulary().concepts if not concept.later]).mean(0)

    def embed(self, texts: Sequence[str]) -> np.ndarray:
        """Unit vectors float32 [n, D]."""
        return unit_rows(self._pooled(texts) - self._mean)

    @torch.no_grad()
    def _pooled(self, texts: Sequence[str]) -> np.ndarray:
        """Unit vectors float32 [n, D] before the mean is taken off."""
        rows = []
        for first in range(0, len(texts), BATCH):
            names = ("input_ids", "attention_mask")
            tokens = tokenized(self._tokenizer, texts[first : first + BATCH], self._model.config, names, padding=True)
            hidden = self._model(**tokens).last_hidden_state
            weight = tokens["attention_mask"][..., None].float()
            pooled = hidden[:, 0] if self._pooling == "cls" else (hidden * weight).sum(1) / weight.sum(1)
            rows.append(torch.nn.functional.normalize(pooled.float(), dim=1).numpy())
        return np.concatenate(rows)


def encoder_at(place: str) -> TextEncoder:
    """The encoder that lies at a place: a file of text vectors, or a model in a folder or in the user's cache. Nothing is downloaded.

    DegenseError in one sentence when there is none that can be read.
    """
    if place.endswith(".safetensors"):
        return TextVectors.read(Path(place).expanduser())
    folder = find_model(place)
    if (folder / "modules.json").exists():
        sentences = SentenceModel(folder)
        return TextTower({sentences.name: sentences.embed})
    model = DenseModel(folder, torch.device("cpu"))
    if not model.has_text_vectors:
        raise DegenseError(f"{folder.name} holds a {model.kind}, which has no text vectors to compare features with; name a CLIP.")
    return TextTower(template_encoders(model.name, model.texts))


def _pooling(folder: Path) -> str:
    """ "mean" or "cls". DegenseError for anything else."""
    try:
        modules = [str(module["type"]).rpartition(".")[2] for module in read_json(folder / "modules.json", MOST_BYTES)]
        pooling: Any = read_json(folder / "1_Pooling" / "config.json", MOST_BYTES)
        chosen = [mode for mode in ("cls_token", "mean_tokens") if pooling.get(f"pooling_mode_{mode}") is True]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DegenseError(f"{folder.name} does not say how its sentence model pools (modules.json, 1_Pooling/config.json).") from error
    others = [name for name, value in pooling.items() if name.startswith("pooling_mode_") and value is True and name[13:] not in chosen]
    if others or len(chosen) != 1 or any(module not in MODULES for module in modules):
        raise DegenseError(f"{folder.name} is a sentence model with more than a transformer and mean or cls pooling, which is not read.")
    return "cls" if chosen == ["cls_token"] else "mean"
