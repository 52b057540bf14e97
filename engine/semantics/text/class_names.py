"""Names that a session or a file gives to things, and which of them a wording means."""

from __future__ import annotations

from collections.abc import Iterable

from degense.engine.semantics.text.spelling import key, words
from degense.engine.semantics.text.vocabulary import Vocabulary


class ClassNames:
    """Names, each with the concept it stands for, if the vocabulary has one.

    A concept goes to one name only: to the one that is the concept's own, else to the first.

    Parameters
    ----------
    names : iterable of str
    vocabulary : Vocabulary

    Attributes
    ----------
    names : tuple of str
    concepts : dict of name to concept
        Of names that own one; the others are found by their very name only.
    """

    def __init__(self, names: Iterable[str], vocabulary: Vocabulary):
        self.names, self.vocabulary = tuple(names), vocabulary
        claims = {name: concept for name in self.names if (concept := vocabulary.known(name)) is not None}
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
