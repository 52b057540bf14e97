"""The text encoder of a run: saved with it, and opened for its prompts; no other encoder fits its features."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from degense.engine.errors import PromptError, RunError
from degense.engine.semantics.text.embedded import EmbeddedEncoder
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.semantics.text.text_vectors import TextVectors, write_vectors
from degense.engine.vocabulary.concepts import surgical_vocabulary

VECTORS_FILE = "text_vectors.safetensors"


def save_encoder(encoder: TextEncoder, folder: Path) -> None:
    """Write into a run folder what prompts need on a machine that has neither the encoder's model nor its file.

    Nothing for the embedded encoder; else the vectors of the session's classes and of all concepts of the vocabulary.
    """
    if encoder.name != EmbeddedEncoder.name:
        write_vectors(folder / VECTORS_FILE, encoder_vectors(encoder), encoder.name)


def encoder_vectors(encoder: TextEncoder) -> dict[str, np.ndarray]:
    """Vectors float32 [D] of the session's classes, and of the names of a file or the concepts that the encoder knows."""
    if isinstance(encoder, TextVectors):
        return {**encoder.vectors, **dict(zip(encoder.classes, encoder.encode(encoder.classes), strict=True))}
    plain = encoder.with_classes(())  # a kind is then itself, not the session's members
    saved = {}
    for concept in surgical_vocabulary().concepts:
        try:
            saved[concept.name] = plain.encode([concept.name])[0]
        except PromptError:
            continue
    return saved | dict(zip(encoder.classes, encoder.encode(encoder.classes), strict=True))


def open_encoder(name: str, classes: Sequence[str], folder: Path, chosen: TextEncoder | None = None) -> TextEncoder:
    """The encoder of a run in `folder`, of the name that made its features; `chosen` is what the user wants prompts to be understood by.

    Raises
    ------
    RunError
        If another encoder was chosen, or nothing is left of the one that made the features.
    """
    if chosen is not None:
        if (same := chosen.for_run(name)) is None:
            raise RunError(f"{folder.name} has features of the text encoder '{name}', so '{chosen.name}' cannot answer its prompts.")
        return same.with_classes(classes)
    if name == EmbeddedEncoder.name:
        return EmbeddedEncoder(classes)
    if not (folder / VECTORS_FILE).is_file():
        raise RunError(
            f"{folder.name} was made with the text encoder '{name}' and lacks {VECTORS_FILE}, which its prompts need; train the clip again."
        )
    saved = TextVectors.read(folder / VECTORS_FILE)
    if saved.name != name:
        raise RunError(f"{folder / VECTORS_FILE} holds vectors of the text encoder '{saved.name}', but the run's features are of '{name}'.")
    return saved.with_classes(classes)
