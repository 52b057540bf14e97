"""Text encoders: from wordings to unit vectors. Image features and text vectors share one space, so a run names its encoder."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence

import numpy as np

from degense.engine.errors import PromptError
from degense.engine.vocabulary.concepts import split_negatives, surgical_vocabulary
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

        Raises
        ------
        PromptError
            For a wording that neither names a session class nor is understood by the vocabulary.
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
