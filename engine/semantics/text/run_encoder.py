"""What a run keeps of its text encoder, and the encoder that answers its prompts: the one that made its features, or none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from degense.engine.errors import PromptError, RunError
from degense.engine.semantics.text.embedded import EmbeddedEncoder
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.semantics.text.text_vectors import TextVectors, write_vectors
from degense.engine.vocabulary.concepts import surgical_vocabulary

KEPT = "text_vectors.safetensors"


def keep_encoder(encoder: TextEncoder, folder: Path) -> None:
    """Write into a run folder what makes it promptable on a machine that has neither the encoder's model nor its file.

    Nothing for the embedded encoder; else the vectors of the session's classes and of all concepts of the vocabulary.
    """
    if encoder.name != EmbeddedEncoder.name:
        write_vectors(folder / KEPT, kept_vectors(encoder), encoder.name)


def kept_vectors(encoder: TextEncoder) -> dict[str, np.ndarray]:
    """Vectors float32 [D] of the session's classes, and of the names of a file or the concepts that the encoder knows."""
    if isinstance(encoder, TextVectors):
        return {**encoder.vectors, **dict(zip(encoder.classes, encoder.encode(encoder.classes), strict=True))}
    plain = encoder.with_classes(())  # a kind is then itself, not the session's members
    kept = {}
    for concept in surgical_vocabulary().concepts:
        try:
            kept[concept.name] = plain.encode([concept.name])[0]
        except PromptError:
            continue
    return kept | dict(zip(encoder.classes, encoder.encode(encoder.classes), strict=True))


def open_encoder(name: str, classes: Sequence[str], folder: Path, chosen: TextEncoder | None = None) -> TextEncoder:
    """The encoder of a run.

    Parameters
    ----------
    name : str
        Of the encoder that made the run's features.
    classes : sequence of str
        The run's.
    folder : Path
        Where the run lies.
    chosen : TextEncoder, optional
        What the user wants prompts to be understood by.

    Raises
    ------
    RunError
        If another encoder was chosen, or nothing is left of the one that made the features.
    """
    if chosen is not None:
        if (same := chosen.called(name)) is None:
            raise RunError(f"{folder.name} has features of the text encoder '{name}', so '{chosen.name}' cannot answer its prompts.")
        return same.with_classes(classes)
    if name == EmbeddedEncoder.name:
        return EmbeddedEncoder(classes)
    if not (folder / KEPT).is_file():
        raise RunError(
            f"{folder.name} was made with the text encoder '{name}' and lacks {KEPT}, so nothing answers its prompts; train the clip again."
        )
    kept = TextVectors.read(folder / KEPT)
    if kept.name != name:
        raise RunError(f"{folder / KEPT} holds vectors of the text encoder '{kept.name}', but the run's features are of '{name}'.")
    return kept.with_classes(classes)
