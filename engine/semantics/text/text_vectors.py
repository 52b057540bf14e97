"""Text vectors from a file: the encoder of features that were computed elsewhere, and of a run whose encoder is not at hand."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from degense.engine.errors import DegenseError, PromptError, RunError
from degense.engine.files import replacing
from degense.engine.semantics.text.encoder import ClassNames, EmbeddedEncoder, TextEncoder
from degense.engine.vocabulary.concepts import surgical_vocabulary

MOST_NAMES, MOST_DIMENSIONS, LONGEST_NAME = 10_000, 65_536, 200
MOST_BYTES = 256 << 20
#: What the file's metadata calls the encoder that made it.
ENCODER = "encoder"


class TextVectors(TextEncoder):
    """An encoder that knows the vectors of some names and of no others.

    Wordings of a name (plurals, synonyms, other languages) are understood where the vocabulary has a concept of that name.

    Vectors float [D] are of any length but zero. The `name` is of the encoder that made them; by default it is derived from names and
    vectors, so that another file is another encoder. PromptError if a class has no vector.
    """

    def __init__(self, vectors: Mapping[str, np.ndarray], name: str | None = None, classes: Sequence[str] = ()):
        super().__init__(classes)
        rows = {word: np.asarray(vector, np.float64) for word, vector in vectors.items()}
        self.vectors = {word: vector / np.linalg.norm(vector) for word, vector in rows.items()}
        self.dimension = len(next(iter(rows.values())))
        self.name = name or _name_of(rows)
        self._names = ClassNames(self.vectors)
        self._class_vectors = {word: self._of_name(word) for word in self.classes}

    @classmethod
    def read(cls, path: Path) -> TextVectors:
        """The vectors of a safetensors file: names → [D] or [1, D]. DegenseError in one sentence for anything else."""
        vectors, metadata = read_vectors(path)
        return cls(vectors, metadata.get(ENCODER))

    def with_classes(self, classes: Sequence[str]) -> TextVectors:
        return TextVectors(self.vectors, self.name, classes)

    def complete(self, prefix: str) -> list[str]:
        known = [word for word in super().complete(prefix) if self.class_names.named(word) or self._known(word)]
        start = prefix.strip().casefold()
        return list(dict.fromkeys([*known, *(word for word in self.vectors if word.casefold().startswith(start))]))

    def _known(self, word: str) -> bool:
        concept = self.vocabulary.known(word)
        return self._names.named(word) is not None or (concept is not None and bool(self._names.members(concept)))

    def _of_name(self, word: str) -> np.ndarray:
        """The vector of a class: of its very name, else of the name that is the same concept."""
        if (named := self._names.named(word)) is not None:
            return self.vectors[named]
        concept = self.vocabulary.known(word)
        same = [name for name, c in self._names.concepts.items() if c == concept]
        if not same:
            raise self._no_vector(word)
        return self.vectors[same[0]]

    def _of_class(self, name: str) -> np.ndarray:
        return self._class_vectors[name]

    def _found(self, text: str) -> dict[str, np.ndarray]:
        if self.class_names.named(text) is None and (named := self._names.named(text)) is not None:
            return {named: self.vectors[named]}
        return super()._found(text)

    def _of_concept(self, concept: str) -> dict[str, np.ndarray]:
        if not (members := self._names.members(concept)):
            raise self._no_vector(concept)
        return {name: self.vectors[name] for name in members}

    def _no_vector(self, word: str) -> PromptError:
        nearest = ", ".join(list(self.vectors)[:8]) + (", …" if len(self.vectors) > 8 else "")
        return PromptError(f"There is no text vector for '{word}'; the encoder '{self.name}' has vectors for {nearest}.")


def read_vectors(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """Names with their vectors float32 [D], and the metadata, of a safetensors file.

    DegenseError if the file is missing, no safetensors file, too large, or holds anything but finite vectors of one length.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise DegenseError(f"{path} is larger than {MOST_BYTES >> 20} MB, which no file of text vectors is.")
        with safe_open(str(path), framework="np") as file:
            names = list(file.keys())
            if not 1 <= len(names) <= MOST_NAMES:
                raise DegenseError(f"{path} holds {len(names)} text vectors; there must be 1 to {MOST_NAMES:,}.")
            shapes = {name: tuple(file.get_slice(name).get_shape()) for name in names}
            lengths = {shape[-1] if len(shape) == 1 or (len(shape) == 2 and shape[0] == 1) else 0 for shape in shapes.values()}
            if len(lengths) != 1 or not 1 <= max(lengths) <= MOST_DIMENSIONS:
                raise DegenseError(f"{path} must hold one vector of the same length for each name, not {_some(shapes)}.")
            vectors = {name: np.asarray(file.get_tensor(name), np.float32).reshape(-1) for name in names}
            metadata = file.metadata() or {}
    except FileNotFoundError as error:
        raise DegenseError(f"{path} does not exist; name a safetensors file of text vectors.") from error
    except (OSError, SafetensorError, TypeError, ValueError) as error:
        raise DegenseError(f"{path} is not a sound safetensors file of float16 or float32 vectors: {error}") from error
    if len(metadata.get(ENCODER, "")) > LONGEST_NAME:
        raise DegenseError(f"{path} names an encoder with more than {LONGEST_NAME} letters, which is no name.")
    for name, vector in vectors.items():
        if not name.strip() or len(name) > LONGEST_NAME:
            raise DegenseError(f"{path} names a vector {name[:40]!r}, which is no name.")
        if not np.isfinite(vector).all() or not np.linalg.norm(vector) > 0:
            raise DegenseError(f"{path}: the vector of '{name}' is zero or not finite.")
    return vectors, metadata


def write_vectors(path: Path, vectors: Mapping[str, np.ndarray], encoder: str) -> None:
    """Write names with vectors [D], and the name of the encoder that made them; whole or not at all."""
    with replacing(path) as temporary:
        save_file({name: np.ascontiguousarray(vector, np.float32) for name, vector in vectors.items()}, temporary, {ENCODER: encoder})


def _name_of(vectors: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(vectors):
        digest.update(name.encode() + b"\0" + vectors[name].astype("<f4").tobytes())
    return f"text-vectors-{digest.hexdigest()[:12]}"


def _some(shapes: Mapping[str, tuple[int, ...]]) -> str:
    return ", ".join(f"{name!r} {list(shape)}" for name, shape in list(shapes.items())[:3])


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

    RunError if another encoder was chosen, or nothing is left of the one that made the features.
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
