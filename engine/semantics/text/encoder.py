"""Text encoders: from wordings to unit vectors. Image features and text vectors share one space, so a run names its encoder."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence

import numpy as np

from degense.engine.errors import PromptError
from degense.engine.vocabulary.concepts import Vocabulary, split_negatives, surgical_vocabulary
from degense.engine.vocabulary.spelling import key, words


class ClassNames:
    """Names, each with the concept it stands for, if the vocabulary has one.

    A concept goes to one name only: to the one that is the concept's own, else to the first. `concepts` are, by name, of those that own
    one; the others are found by their very name only.
    """

    def __init__(self, names: Iterable[str]):
        self.names, self.vocabulary = tuple(names), surgical_vocabulary()
        claims = {name: concept for name in self.names if (concept := self.vocabulary.known(name)) is not None}
        owners: dict[str, str] = {}
        for name in sorted(claims, key=self._rank):  # stable: the first of equals
            owners.setdefault(claims[name], name)
        self.concepts = {name: concept for name, concept in claims.items() if owners[concept] == name}
        self._by_key = {key(name): name for name in reversed(self.names) if key(name)}

    def _rank(self, name: str) -> int:
        concept = self.vocabulary.exact(name)
        return 2 if concept is None else 0 if key(concept) == key(name) else 1

    def named(self, text: str) -> str | None:
        """The one with this very name; case, plural, hyphens and words like "the" aside."""
        if text in self.names:
            return text
        meant = " ".join(word for word in words(text) if word not in self.vocabulary.fillers)
        return self._by_key.get(key(text)) or self._by_key.get(key(meant))

    def members(self, concept: str) -> list[str]:
        """Those that are the concept; else those that belong to it: all instruments of "tool"."""
        own = [name for name, c in self.concepts.items() if c == concept]
        return own or [name for name, c in self.concepts.items() if concept in self.vocabulary.ancestors(c)]


class TextEncoder(ABC):
    """Turns wordings into vectors of one space: a prompt names session classes or concepts of the vocabulary, each of which has a vector.

    The session's `classes` win over the vocabulary.
    """

    name: str  # written into a run, whose features fit no other encoder. It changes with everything that changes a vector
    dimension: int  # D, the length of a vector

    def __init__(self, classes: Sequence[str] = ()):
        self.vocabulary = surgical_vocabulary()
        self.classes = tuple(classes)
        self.class_names = ClassNames(self.classes)

    @abstractmethod
    def _of_class(self, name: str) -> np.ndarray:
        """Unit vector [D] of a session class."""

    @abstractmethod
    def _of_concept(self, concept: str) -> dict[str, np.ndarray]:
        """Unit vectors, by name, of a concept that no session class is or belongs to. PromptError where there is none."""

    @abstractmethod
    def with_classes(self, classes: Sequence[str]) -> TextEncoder:
        """The same space, in which each of these class names is understood literally."""

    def for_run(self, name: str) -> TextEncoder | None:
        """The encoder of the name that a run holds: this one, or this model with the templates of that run; None for another."""
        return self if name == self.name else None

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """float32 [n, D], unit rows: each has the same cosine to all that its text covers.

        PromptError for a wording that neither names a session class nor is understood by the vocabulary.
        """
        rows = [_balanced(np.stack(list(self._read(text)[0].values()))) for text in texts]
        return np.array(rows, np.float32).reshape(-1, self.dimension)

    def expand(self, text: str) -> np.ndarray:
        """float32 [m, D]: a row for each session class the text covers (all instruments for "tool"), else its own row.

        A `FrameSemantics` keeps the best of such rows in each pixel: sharper than the one vector of `encode` when a kind has many members.
        """
        return np.stack(list(self._read(text)[0].values())).astype(np.float32)

    def exclude(self, text: str) -> np.ndarray:
        """float32 [k, D]: a row for each class or concept that the text excludes."""
        return np.array(list(self._read(text)[1].values()), np.float32).reshape(-1, self.dimension)

    def complete(self, prefix: str) -> list[str]:
        """Wordings to offer for a beginning, the session's classes first."""
        return self.vocabulary.complete(prefix, self.classes)

    def _read(self, text: str) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """What a prompt includes and excludes: vectors by name."""
        if (named := self.class_names.named(text)) is not None:
            return {named: self._of_class(named)}, {}
        wanted, others = split_negatives(text)
        if not others:
            return self._found(wanted or text), {}
        if not wanted.strip(" ,;"):
            raise PromptError(f"'{text}' says only what it does not mean; name what to look for first, as in 'tool, not grasper'.")
        excluded = {name: vector for other in others for name, vector in self._found(other).items()}
        included = {name: vector for name, vector in self._found(wanted).items() if name not in excluded}
        if not included:
            raise PromptError(f"'{text}' leaves nothing to look for: all that it names is excluded again.")
        return included, excluded

    def _found(self, text: str) -> dict[str, np.ndarray]:
        if (named := self.class_names.named(text)) is not None:
            return {named: self._of_class(named)}
        literal = [name for name in self.classes if name not in self.class_names.concepts]
        concept = self.vocabulary.resolve(text, literal)
        return {name: self._of_class(name) for name in self.class_names.members(concept)} or self._of_concept(concept)


def _balanced(rows: np.ndarray) -> np.ndarray:
    """The unit vector with the same, largest possible cosine to every unit row: normalised Vᵀ(VVᵀ)⁺1."""
    if len(rows) == 1:
        return rows[0]
    direction = rows.T @ np.linalg.pinv(rows @ rows.T) @ np.ones(len(rows))
    return direction / np.linalg.norm(direction)


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
