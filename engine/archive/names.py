"""What an index calls things: the classes of a run and the kinds they belong to, and which of them a name in a question means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.semantics.examples import split_examples
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.vocabulary.concepts import surgical_vocabulary

#: Most things of a run that are indexed; a mask's number is a byte.
MOST_THINGS = 250


class NeedsRun(DegenseError):
    """Only the run itself can answer this; the sentence says why."""


@dataclass(frozen=True)
class Things:
    """What is indexed of a run, each with a mask in every frame."""

    classes: tuple[str, ...]
    kinds: tuple[tuple[str, tuple[str, ...]], ...]  # concepts of the vocabulary that several classes belong to ("instrument"), with these
    closed: bool  # whether nothing but the classes has features in the run, so that what is none of them is not there

    @classmethod
    def of(cls, classes: Sequence[str], closed: bool) -> Things:
        names = _Names(tuple(classes)).class_names
        found: dict[tuple[str, ...], str] = {}
        for concept in surgical_vocabulary().concepts:
            members = tuple(sorted(names.members(concept.name)))
            if len(members) > 1 and names.named(concept.name) is None:
                found.setdefault(members, concept.name)
        room = max(0, MOST_THINGS - len(classes))
        return cls(tuple(classes), tuple((name, members) for members, name in list(found.items())[:room]), closed)

    @property
    def names(self) -> tuple[str, ...]:
        return (*self.classes, *(name for name, _ in self.kinds))

    def meant(self, text: str) -> str | None:
        """The one of `names` that a noun means; None where the run holds nothing of that name.

        PromptError where it is not understood, `NeedsRun` where the run itself must be asked.
        """
        if split_examples(text)[1]:
            raise NeedsRun(f"'{text}' looks for what is like a place in a picture, which only an opened run can compare.")
        included, excluded = _encoder(self.classes).read(text)
        there = included & {*self.classes}
        if included - there and not self.closed:
            raise NeedsRun(f"'{text}' is no class of the run, whose encoder knows more than its classes.")
        if not there:
            return None
        if len(there) == 1:
            return next(iter(there))
        kind = next((name for name, members in self.kinds if there == {*members}), None)
        if kind is None or excluded & {*self.classes}:
            raise NeedsRun(f"'{text}' means several classes that have no name in common.")
        return kind


class _Names(TextEncoder):
    """Reads prompts as the encoder of a run does, for the names that they mean instead of vectors."""

    name, dimension = "names", 1

    def read(self, text: str) -> tuple[set[str], set[str]]:
        """What a text includes and excludes: classes, or a concept that no class is or belongs to."""
        included, excluded = self._read(text)
        return {*included}, {*excluded}

    def _of_class(self, name: str) -> np.ndarray:
        return np.ones(1)

    def _of_concept(self, concept: str) -> dict[str, np.ndarray]:
        return {concept: np.ones(1)}

    def with_classes(self, classes: Sequence[str]) -> _Names:
        return _Names(classes)


@lru_cache(maxsize=256)
def _encoder(classes: tuple[str, ...]) -> _Names:
    return _Names(classes)
