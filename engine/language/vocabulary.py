"""The embedded surgical vocabulary: which concept a wording means.

The words are data (`vocabulary.json`); this file knows how to read a prompt: articles and polite words, plurals, joined and hyphenated
spellings, abbreviations and small misspellings. A wording that is not understood is an error that names the nearest ones, never a guess.
"""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cached_property, lru_cache
from importlib.resources import files

from engine.errors import PromptError

#: A prompt longer than this is not a name of anything, and matching would only waste time.
MAX_PROMPT = 200
#: Longest name, in words.
LONGEST_NAME = 6


@dataclass(frozen=True)
class Concept:
    """One thing that can be named.

    Attributes
    ----------
    name : str
        The canonical wording.
    of : str or None
        The whole or kind it belongs to.
    share : float
        Cosine between two children of this concept.
    also : tuple of str
        Other wordings.
    """

    name: str
    of: str | None = None
    share: float = 0.0
    also: tuple[str, ...] = ()


def words(text: str) -> list[str]:
    """Lower-case words in the singular, without accents, punctuation and underscores: `"L-Hooks!"` → `["l", "hook"]`."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", text)
    plain = unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode().casefold().replace("'s ", " ").replace("'", "")
    return [_singular(word) for word in re.findall(r"[a-z0-9]+", plain)]


def _singular(word: str) -> str:
    """The singular, or the same odd form for a name and its plural: both sides of a comparison go through here."""
    if len(word) > 4 and word.endswith("ies"):
        return word[:-3] + "y"
    if len(word) > 4 and word.endswith(("sses", "shes", "ches", "xes")):
        return word[:-2]
    if len(word) > 3 and word.endswith("s") and not word.endswith(("ss", "us", "is")):
        return word[:-1]
    return word


def key(text: str) -> str:
    """What is compared: the words joined, so that "gall bladder", "gall-bladder" and "Gallbladders" are one."""
    return "".join(words(text))


def edit_distance(a: str, b: str) -> int:
    """Insertions, deletions, substitutions and swaps of neighbours between two words (optimal string alignment)."""
    before: list[int] = []
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        oldest, before, row = before, row, [i]
        for j, y in enumerate(b, 1):
            cost = min(before[j] + 1, row[j - 1] + 1, before[j - 1] + (x != y))
            if i > 1 and j > 1 and x == b[j - 2] and a[i - 2] == y:
                cost = min(cost, oldest[j - 2] + 1)
            row.append(cost)
    return row[-1]


def allowed_errors(length: int) -> int:
    """Slips of the finger that are forgiven in a name of so many letters; short words differ by one letter from too many others."""
    return 0 if length < 5 else 1 if length < 8 else 2 if length < 13 else 3


class Vocabulary:
    """Concepts and their wordings, and the rules that find a concept in a prompt.

    Parameters
    ----------
    concepts : sequence of Concept
        In the order that fixes their vectors; names are unique, and a whole comes before its parts.
    fillers, prepositions, not_misspellings : iterable of str
        Words that say nothing about what is meant; words that end a noun phrase; real words that look like a misspelt name and are none.
    """

    def __init__(
        self,
        concepts: Sequence[Concept],
        fillers: Iterable[str] = (),
        prepositions: Iterable[str] = (),
        not_misspellings: Iterable[str] = (),
    ):
        self.concepts = tuple(concepts)
        self.prepositions = frozenset(prepositions)
        self.fillers = frozenset(word for filler in fillers for word in (filler, *words(filler))) | self.prepositions
        self.not_misspellings = frozenset(word for real in not_misspellings for word in words(real))
        self._by_key = {key(wording): concept.name for concept in self.concepts for wording in (concept.name, *concept.also)}

    @cached_property
    def by_name(self) -> dict[str, Concept]:
        return {concept.name: concept for concept in self.concepts}

    def ancestors(self, name: str) -> list[str]:
        """The wholes and kinds a concept belongs to, nearest first."""
        whole = self.by_name[name].of
        return [] if whole is None else [whole, *self.ancestors(whole)]

    def exact(self, text: str) -> str | None:
        """The concept with this very wording (case, plural, hyphens and spaces aside), or None."""
        return self._by_key.get(key(text))

    def is_a(self, text: str, kind: str) -> bool:
        """Whether `text` is exactly a wording of the concept `kind` or of something that belongs to it."""
        concept = self.exact(text)
        return concept is not None and (concept == kind or kind in self.ancestors(concept))

    def resolve(self, text: str, also: Sequence[str] = ()) -> str:
        """The name of the concept that a prompt means; `also` are further names that an error may suggest.

        Raises
        ------
        PromptError
            If the prompt is empty, holds a word that is not understood, or names more than one thing.
        """
        text = text[:MAX_PROMPT]
        tokens = words(text)
        if not tokens:
            raise PromptError("The prompt is empty; type the name of an organ, a tissue or an instrument.")
        concepts, unknown = self._read(tokens)
        if not unknown and len(concepts) > 1:
            # "fat around the gallbladder" is about fat: the noun phrase before the preposition is the head
            concepts = next((found for phrase in self._phrases(tokens) if (found := self._read(phrase)[0])), concepts)
        if unknown or not concepts:
            nearest = ", ".join(self.nearest(text, also))
            raise PromptError(f"'{_short(' '.join(unknown) or text)}' is not in the vocabulary; nearest are {nearest}.")
        if len(concepts) > 1:
            raise PromptError(f"'{_short(text)}' names {' and '.join(concepts)}; prompt them one at a time.")
        return concepts[0]

    def complete(self, prefix: str, first: Sequence[str] = ()) -> list[str]:
        """Wordings that begin like `prefix` (any of their words may), those of `first` before the others; all names for an empty prefix."""
        wanted = " ".join(prefix.casefold().replace("_", " ").replace("-", " ").split())
        wordings = dict.fromkeys([*first, *(c.name for c in self.concepts), *(also for c in self.concepts for also in c.also)])
        if not wanted:
            return list(dict.fromkeys([*first, *(c.name for c in self.concepts)]))
        plain = {wording: wording.casefold().replace("_", " ").replace("-", " ") for wording in wordings}
        starts = [w for w, p in plain.items() if p.startswith(wanted)]
        inside = [w for w, p in plain.items() if f" {wanted}" in p]
        chosen = set(first)
        return sorted(dict.fromkeys([*starts, *inside]), key=lambda wording: wording not in chosen)

    def nearest(self, text: str, also: Sequence[str] = (), count: int = 3) -> list[str]:
        """The wordings that look most like a text, best first, one a concept; for error messages."""
        wanted = key(text)
        scores: dict[str, float] = {}
        for wording, name in [*((extra, extra) for extra in also), *((w, c.name) for c in self.concepts for w in (c.name, *c.also))]:
            scores[name] = max(scores.get(name, 0.0), SequenceMatcher(None, wanted, key(wording)).ratio())
        return sorted(scores, key=scores.__getitem__, reverse=True)[:count]

    def _phrases(self, tokens: list[str]) -> list[list[str]]:
        phrases: list[list[str]] = [[]]
        for token in tokens:
            if token in self.prepositions:
                phrases.append([])
            else:
                phrases[-1].append(token)
        return phrases

    def _read(self, tokens: list[str]) -> tuple[list[str], list[str]]:
        """Concepts named in the tokens, longest names first at each place, and the words that were not understood."""
        named: list[str] = []
        in_passing: list[str] = []
        unknown: list[str] = []
        at = 0
        while at < len(tokens):
            name, used = self._name_at(tokens, at)
            filler = used == 1 and tokens[at] in self.fillers
            if name is not None:
                # "highlight" names a reflection when it stands alone, and is a verb in "highlight the hook"
                (in_passing if filler else named).append(name)
            elif not filler:
                unknown.append(tokens[at])
            at += used
        return list(dict.fromkeys(named or in_passing)), unknown

    def _name_at(self, tokens: list[str], at: int) -> tuple[str | None, int]:
        sizes = range(min(LONGEST_NAME, len(tokens) - at), 0, -1)
        for size in sizes:
            if (name := self._by_key.get("".join(tokens[at : at + size]))) is not None:
                return name, size
        for size in sizes:
            window = tokens[at : at + size]
            # a window may not begin or end with a filler or reach into another name: "the liver" is no misspelling of anything
            whole = any(token in self.fillers or token in self.not_misspellings for token in (window[0], window[-1]))
            if not whole and (name := self._misspelt("".join(window))) is not None:
                return name, size
        return None, 1

    def _misspelt(self, wording: str) -> str | None:
        """The concept whose wording differs by no more than `allowed_errors`; None when there is none, or two are equally near."""
        best: dict[str, int] = {}
        for known, name in self._by_key.items():
            limit = allowed_errors(max(len(known), len(wording)))
            if (
                limit
                and known[0] == wording[0]
                and abs(len(known) - len(wording)) <= limit
                and (d := edit_distance(wording, known)) <= limit
            ):
                best[name] = min(d, best.get(name, limit))
        nearest = [name for name, distance in best.items() if distance == min(best.values())]
        return nearest[0] if len(nearest) == 1 else None


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "…"


@lru_cache(maxsize=1)
def surgical_vocabulary() -> Vocabulary:
    """The vocabulary that comes with the project, read once."""
    data = json.loads(files("engine.language").joinpath("vocabulary.json").read_text(encoding="utf-8"))
    concepts = [
        Concept(entry["name"], entry.get("of"), entry.get("share", 0.0), tuple(entry.get("also", ()))) for entry in data["concepts"]
    ]
    return Vocabulary(concepts, data["fillers"], data["prepositions"], data["not_misspellings"])
