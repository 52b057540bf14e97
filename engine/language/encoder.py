"""Text encoders: wordings in, unit vectors out. Vision and text must live in one space, so a run names its encoder and refuses another."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from engine.errors import RunError
from engine.language.vocabulary import Vocabulary, key, surgical_vocabulary, words


class TextEncoder(Protocol):
    """Turns wordings into vectors of one space.

    Attributes
    ----------
    name : str
        Written into a run; features of one encoder mean nothing to another.
    dimension : int
        D, the length of a vector.
    """

    name: str
    dimension: int

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """float32 [n, D], unit rows. PromptError for a wording that is not understood, naming the nearest ones."""
        ...

    def with_classes(self, classes: Sequence[str]) -> TextEncoder:
        """The same space, in which each of the session's class names is understood literally."""
        ...

    def expand(self, text: str) -> np.ndarray:
        """float32 [m, D], m ≥ 1: a row for each session class that the text covers (all instruments for "tool"), else its own row."""
        ...

    def complete(self, prefix: str) -> list[str]:
        """Wordings to offer for a beginning, the session's classes first."""
        ...


class EmbeddedEncoder:
    """The surgical vocabulary as a vector space; needs no download and gives the same numbers on every machine.

    Each concept owns one axis. A concept of a kind (a grasper of instrument) is √share · kind + √(1 − share) · own axis:
    two concepts of one kind have the cosine `share` (instruments 0.35, organs 0.15, other tissue 0.05); strangers are orthogonal.
    A session class that the vocabulary does not know becomes a literal class: a vector drawn from the SHA-256 of its name,
    on axes kept for such classes and orthogonal to the literal classes before it.
    A prompt that names a kind ("tool") means the session's classes of that kind: the one direction with the same cosine to each of them.

    Parameters
    ----------
    classes : sequence of str
        Names of the session's classes; they win over the vocabulary.
    vocabulary : Vocabulary

    Attributes
    ----------
    literal : tuple of str
        Session classes that have no concept of their own: only their exact name finds them.
    """

    name = "embedded-surgical-1"
    dimension = 128
    #: Axes kept for concepts; the rest carries literal classes.
    concept_axes = 96

    def __init__(self, classes: Sequence[str] = (), vocabulary: Vocabulary | None = None):
        self.vocabulary = vocabulary or surgical_vocabulary()
        self.classes = tuple(classes)
        self._vectors = _concept_vectors(self.vocabulary, self.dimension, self.concept_axes)
        self._class_concepts = _claim_concepts(self.classes, self.vocabulary)
        self.literal = tuple(name for name in self.classes if name not in self._class_concepts)
        literal = _literal_vectors(self.literal, self.dimension, self.concept_axes)
        self._class_vectors = {
            name: literal[name] if name in literal else self._vectors[self._class_concepts[name]] for name in self.classes
        }
        self._by_key = {key(name): name for name in reversed(self.classes) if key(name)}

    def with_classes(self, classes: Sequence[str]) -> EmbeddedEncoder:
        return EmbeddedEncoder(classes, self.vocabulary)

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """float32 [n, D], unit rows.

        Raises
        ------
        PromptError
            For a wording that neither names a session class nor is understood by the vocabulary.
        """
        return np.array([_balanced(self._rows(text)) for text in texts], np.float32).reshape(-1, self.dimension)

    def expand(self, text: str) -> np.ndarray:
        """float32 [m, D]: a row for each session class the text covers (all instruments for "tool"), else its own row.

        A `MaskQuery` keeps the best of such rows in each pixel: sharper than the one vector of `encode` when a kind has many members.
        """
        return self._rows(text).astype(np.float32)

    def complete(self, prefix: str) -> list[str]:
        return self.vocabulary.complete(prefix, self.classes)

    def _rows(self, text: str) -> np.ndarray:
        if (named := self._class_named(text)) is not None:
            return self._class_vectors[named][None]
        concept = self.vocabulary.resolve(text, self.literal)
        return np.stack([self._class_vectors[name] for name in self._members(concept)] or [self._vectors[concept]])

    def _class_named(self, text: str) -> str | None:
        """The session class with this very name; case, plural, hyphens and words like "the" aside."""
        if text in self._class_vectors:
            return text
        meant = "".join(word for word in words(text) if word not in self.vocabulary.fillers)
        return self._by_key.get(key(text)) or self._by_key.get(meant)

    def _members(self, concept: str) -> list[str]:
        """Session classes that are the concept or belong to it; a concept that is a session class itself means just that one."""
        own = [name for name, c in self._class_concepts.items() if c == concept]
        return own or [name for name, c in self._class_concepts.items() if concept in self.vocabulary.ancestors(c)]


def encoder_by_name(name: str, classes: Sequence[str] = ()) -> TextEncoder:
    """The encoder that a run was made with.

    Raises
    ------
    RunError
        If this version has no encoder of that name.
    """
    if name != EmbeddedEncoder.name:
        known = EmbeddedEncoder.name
        raise RunError(f"This run was made with the text encoder '{name}', but this version only has '{known}'; train the clip again.")
    return EmbeddedEncoder(classes)


def _claim_concepts(classes: Sequence[str], vocabulary: Vocabulary) -> dict[str, str]:
    """Which concept each session class stands for. A concept goes to one class only: the one that bears its name, else the first."""
    claims = {name: concept for name in classes if (concept := vocabulary.exact(name)) is not None}
    owners: dict[str, str] = {}
    for name, concept in claims.items():
        if concept not in owners or (key(name) == key(concept) and key(owners[concept]) != key(concept)):
            owners[concept] = name
    return {name: concept for name, concept in claims.items() if owners[concept] == name}


def _concept_vectors(vocabulary: Vocabulary, dimension: int, axes: int) -> dict[str, np.ndarray]:
    if len(vocabulary.concepts) > axes:
        raise ValueError(f"{len(vocabulary.concepts)} concepts do not fit into {axes} axes")
    vectors: dict[str, np.ndarray] = {}
    for axis, concept in enumerate(vocabulary.concepts):
        own = np.zeros(dimension)
        own[axis] = 1.0
        if concept.of is not None:
            share = vocabulary.by_name[concept.of].share
            own = np.sqrt(share) * vectors[concept.of] + np.sqrt(1.0 - share) * own
        vectors[concept.name] = own
    return vectors


def _literal_vector(name: str, dimension: int, first: int) -> np.ndarray:
    """A unit vector drawn from the SHA-256 of the name, zero on the concepts' axes."""
    seed = hashlib.sha256(name.encode()).digest()
    drawn = np.frombuffer(b"".join(hashlib.sha256(seed + bytes([i])).digest() for i in range(dimension // 8)), "<u4")[: dimension - first]
    # a sum of the four bytes' deviations is close to normal, exact in binary, and does not lean on any generator's version
    vector = np.zeros(dimension)
    vector[first:] = drawn.view(np.uint8).reshape(-1, 4).astype(np.float64).sum(1) - 510.0
    return vector / np.linalg.norm(vector)


def _literal_vectors(names: Sequence[str], dimension: int, first: int) -> dict[str, np.ndarray]:
    """Vectors of the literal classes, each orthogonal to those before it as long as the axes suffice; beyond that they are only random."""
    vectors: dict[str, np.ndarray] = {}
    for name in dict.fromkeys(names):
        vector = _literal_vector(name, dimension, first)
        if len(vectors) < dimension - first:
            rows = np.array(list(vectors.values())).reshape(-1, dimension)
            vector = vector - rows.T @ (rows @ vector)
        vectors[name] = vector / np.linalg.norm(vector)
    return vectors


def _balanced(rows: np.ndarray) -> np.ndarray:
    """The unit vector with the same, largest possible cosine to every unit row: normalised Vᵀ(VVᵀ)⁺1."""
    direction = rows.T @ np.linalg.pinv(rows @ rows.T) @ np.ones(len(rows))
    return direction / np.linalg.norm(direction)
