"""The surgical vocabulary as a vector space."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.vocabulary.concepts import Vocabulary

DIMENSION = 128
CONCEPT_AXES = 96  # kept for concepts; the rest carries literal classes


class EmbeddedEncoder(TextEncoder):
    """The surgical vocabulary as a vector space; needs no download and gives the same numbers on every machine.

    Each concept owns one axis. A concept of a kind (a grasper of instrument) is √share · kind + √(1 − share) · own axis:
    two concepts of one kind have the cosine `share` (instruments 0.35, organs 0.15, other tissue 0.05); others are orthogonal.
    A session class that the vocabulary does not know becomes a literal class: a vector drawn from the SHA-256 of its name,
    on axes kept for such classes and orthogonal to the literal classes before it.
    A prompt that names a kind ("tool") means the session's classes of that kind: the one direction with the same cosine to each of them.
    `literal` are the classes without the vector of a concept: the vocabulary does not know their name, or only in another language.
    """

    name = "embedded-surgical-1"
    dimension = DIMENSION

    def __init__(self, classes: Sequence[str] = ()):
        super().__init__(classes)
        self._vectors = _concept_vectors(self.vocabulary)
        concepts = {name: concept for name, concept in self.class_names.concepts.items() if self.vocabulary.exact(name) == concept}
        self.literal = tuple(name for name in self.classes if name not in concepts)
        literal = _literal_vectors(self.literal)
        self._class_vectors = {name: literal[name] if name in literal else self._vectors[concepts[name]] for name in self.classes}

    def with_classes(self, classes: Sequence[str]) -> EmbeddedEncoder:
        return EmbeddedEncoder(classes)

    def _of_class(self, name: str) -> np.ndarray:
        return self._class_vectors[name]

    def _of_concept(self, concept: str) -> dict[str, np.ndarray]:
        return {concept: self._vectors[concept]}


def _concept_vectors(vocabulary: Vocabulary) -> dict[str, np.ndarray]:
    if len(vocabulary.concepts) > CONCEPT_AXES:
        raise ValueError(f"{len(vocabulary.concepts)} concepts do not fit into {CONCEPT_AXES} axes")
    vectors: dict[str, np.ndarray] = {}
    for own, concept in zip(np.eye(DIMENSION), vocabulary.concepts, strict=False):
        if concept.of is not None:
            share = vocabulary.by_name[concept.of].share
            own = np.sqrt(share) * vectors[concept.of] + np.sqrt(1.0 - share) * own
        vectors[concept.name] = own
    return vectors


def _literal_vector(name: str) -> np.ndarray:
    """A unit vector drawn from the SHA-256 of the name, zero on the concepts' axes."""
    seed = hashlib.sha256(name.encode()).digest()
    drawn = np.frombuffer(b"".join(hashlib.sha256(seed + bytes([i])).digest() for i in range((DIMENSION - CONCEPT_AXES) // 8)), "<u4")
    # a sum of the four bytes' deviations is close to normal, exact in binary, and does not lean on any generator's version
    vector = np.zeros(DIMENSION)
    vector[CONCEPT_AXES:] = drawn.view(np.uint8).reshape(-1, 4).astype(np.float64).sum(1) - 510.0
    return vector / np.linalg.norm(vector)


def _literal_vectors(names: Sequence[str]) -> dict[str, np.ndarray]:
    """Vectors of the literal classes, each orthogonal to those before it as long as the axes suffice; beyond that they are only random."""
    vectors: dict[str, np.ndarray] = {}
    for name in dict.fromkeys(names):
        vector = _literal_vector(name)
        if len(vectors) < DIMENSION - CONCEPT_AXES:
            rows = np.array(list(vectors.values())).reshape(-1, DIMENSION)
            vector = vector - rows.T @ (rows @ vector)
        vectors[name] = vector / np.linalg.norm(vector)
    return vectors
