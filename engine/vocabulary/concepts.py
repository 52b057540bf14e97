"""The embedded surgical vocabulary: which concept a wording means.

The words are data: `vocabulary.json` fixes the concepts and so their vectors, `names.json` adds wordings in English and other languages.
This file knows how to read a prompt: articles and polite words, plurals, joined and hyphenated spellings, abbreviations and small
misspellings. A wording that is not understood is an error that names the nearest ones, never a guess.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cached_property, lru_cache
from importlib.resources import files
from itertools import groupby
from typing import Any

from degense.engine.errors import PromptError
from degense.engine.vocabulary.spelling import HAN, allowed_errors, allowed_errors_foreign, american, key, spelling_errors, words

#: A prompt longer than this is not a name of anything, and matching would only waste time.
MAX_PROMPT = 200
#: Longest name, in words.
LONGEST_NAME = 8


@dataclass(frozen=True)
class Concept:
    """One thing that can be named."""

    name: str  # the canonical wording
    of: str | None = None  # the whole or kind it belongs to
    share: float = 0.0  # cosine between two children of this concept
    also: tuple[str, ...] = ()  # other wordings that a class of a session may bear too, which then has the concept's vector
    #: Wordings that were added later, in English and in other languages: for prompts only, because runs exist whose classes bear them.
    names: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()
    later: bool = False  # added later itself: a class of its name has a vector of its own, like any class that is no concept

    @property
    def wordings(self) -> tuple[str, ...]:
        """All of them, the name first."""
        return (self.name, *self.also, *self.names, *self.foreign)


class Vocabulary:
    """Concepts and their wordings, and the rules that find a concept in a prompt.

    Concepts are in the order that fixes their vectors; names are unique, and a whole comes before its parts. Fillers are words without
    information, prepositions end a noun phrase, and `not_misspellings` are real words that look like a misspelt name and are none.
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
        self._by_key = {key(wording): concept.name for concept in self.concepts for wording in concept.wordings}
        self._of_classes = {
            key(wording): concept.name for concept in self.concepts if not concept.later for wording in (concept.name, *concept.also)
        }
        # names that a misspelling may be taken for, and how many errors are tolerated; English first: it wins where languages share a name
        self._tolerance = {key(wording): allowed_errors_foreign(key(wording)) for concept in self.concepts for wording in concept.foreign}
        self._tolerance |= {
            key(wording): allowed_errors(key(wording))
            for concept in self.concepts
            for wording in (concept.name, *concept.also, *concept.names)
        }

    @cached_property
    def by_name(self) -> dict[str, Concept]:
        return {concept.name: concept for concept in self.concepts}

    def ancestors(self, name: str) -> list[str]:
        """The wholes and kinds a concept belongs to, nearest first."""
        whole = self.by_name[name].of
        return [] if whole is None else [whole, *self.ancestors(whole)]

    def exact(self, text: str) -> str | None:
        """The concept whose vector a class of this name has: it has this very wording (case, plural, hyphens and spaces aside); or None."""
        return self._of_classes.get(key(text))

    def known(self, text: str) -> str | None:
        """The concept with this very wording in any language, or None."""
        return self._by_key.get(key(text))

    def is_a(self, text: str, kind: str) -> bool:
        """Whether `text` is exactly a wording of the concept `kind` or of something that belongs to it."""
        concept = self.known(text)
        return concept is not None and (concept == kind or kind in self.ancestors(concept))

    def resolve(self, text: str, also: Sequence[str] = ()) -> str:
        """The name of the concept that a prompt means; `also` are further names that an error may suggest.

        PromptError if the prompt is empty, holds a word that is not understood, or names more than one thing.
        """
        text = text[:MAX_PROMPT]
        tokens = words(text)
        if not tokens:
            raise PromptError("The prompt is empty; type the name of an organ, a tissue or an instrument.")
        concepts, unknown = self._read(tokens)
        if not unknown and len(concepts) > 1:
            # "fat around the gallbladder" is about fat: the noun phrase before the preposition is the head
            phrases = (list(phrase) for ends, phrase in groupby(tokens, self.prepositions.__contains__) if not ends)
            concepts = next((found for phrase in phrases if (found := self._read(phrase)[0])), concepts)
        if unknown or not concepts:
            nearest = ", ".join(self.nearest(text, also))
            raise PromptError(f"'{_short(' '.join(unknown) or text)}' is not in the vocabulary; nearest are {nearest}.")
        if len(concepts) > 1:
            raise PromptError(f"'{_short(text)}' names {' and '.join(concepts)}; prompt them one at a time.")
        return concepts[0]

    def complete(self, prefix: str, first: Sequence[str] = ()) -> list[str]:
        """Wordings that begin like `prefix` (any of their words may), those of `first` before the others; all names for an empty prefix."""
        names = [*first, *(c.name for c in self.concepts)]
        if not (wanted := " ".join(_plain(prefix).split())):
            return list(dict.fromkeys(names))
        plain = {wording: _plain(wording) for wording in (*names, *(w for c in self.concepts for w in c.wordings))}
        starts = [w for w, p in plain.items() if p.startswith(wanted)]
        inside = [w for w, p in plain.items() if f" {wanted}" in p]
        return sorted(dict.fromkeys([*starts, *inside]), key=lambda wording: wording not in first)

    def nearest(self, text: str, also: Sequence[str] = (), count: int = 3) -> list[str]:
        """The wordings that look most like a text, best first, one a concept; for error messages."""
        wanted = key(text)
        scores: dict[str, float] = {}
        for wording, name in [*((extra, extra) for extra in also), *((w, c.name) for c in self.concepts for w in c.wordings)]:
            scores[name] = max(scores.get(name, 0.0), SequenceMatcher(None, wanted, key(wording)).ratio())
        return sorted(scores, key=scores.__getitem__, reverse=True)[:count]

    def corrections(self, text: str) -> list[tuple[str, str]]:
        """What was misspelt in a prompt and is understood all the same: as typed, and the name of the concept that it is taken for."""
        tokens, found, at = words(text[:MAX_PROMPT]), [], 0
        while at < len(tokens):
            name, used = self._name_at(tokens, at)
            if name is not None and "".join(map(american, tokens[at : at + used])) not in self._by_key:
                found.append((" ".join(tokens[at : at + used]), name))
            at += used
        return found

    def _read(self, tokens: list[str]) -> tuple[list[str], list[str]]:
        """Concepts named in the tokens, longest names first at each place, and the words that were not understood."""
        named: list[str] = []
        fillers_named: list[str] = []
        unknown: list[str] = []
        at = 0
        while at < len(tokens):
            name, used = self._name_at(tokens, at)
            filler = used == 1 and tokens[at] in self.fillers
            if name is not None:
                # "highlight" names a reflection when it stands alone, and is a verb in "highlight the hook"
                (fillers_named if filler else named).append(name)
            elif not filler:
                unknown.append(tokens[at])
            at += used
        return list(dict.fromkeys(named or fillers_named)), unknown

    def _name_at(self, tokens: list[str], at: int) -> tuple[str | None, int]:
        sizes = range(min(LONGEST_NAME, len(tokens) - at), 0, -1)
        for size in sizes:
            if (name := self._by_key.get("".join(map(american, tokens[at : at + size])))) is not None:
                return name, size
        for size in sizes:
            window = tokens[at : at + size]
            # a window may not begin or end with a filler or reach into another name: "the liver" is no misspelling of anything
            whole = any(token in self.fillers or token in self.not_misspellings for token in (window[0], window[-1]))
            if not whole and (name := self._misspelt("".join(map(american, window)))) is not None:
                return name, size
        return None, 1

    def _misspelt(self, wording: str) -> str | None:
        """The concept whose wording differs by no more than `allowed_errors`; None when there is none, or two are equally near."""
        best: dict[str, int] = {}
        for known, allowed in self._tolerance.items():
            if (distance := spelling_errors(wording, known, allowed)) is not None:
                name = self._by_key[known]
                best[name] = min(distance, best.get(name, distance))
        nearest = [name for name, distance in best.items() if distance == min(best.values())]
        return nearest[0] if len(nearest) == 1 else None


def _plain(text: str) -> str:
    return text.casefold().replace("_", " ").replace("-", " ")


def _short(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "…"


@lru_cache(maxsize=1)
def surgical_vocabulary() -> Vocabulary:
    """The vocabulary that comes with the project, read once."""
    fixed, added = (read_json(name) for name in ("vocabulary.json", "names.json"))
    names: dict[str, dict[str, Any]] = added["names"]
    entries = fixed["concepts"] + [{"name": name, "of": by["of"], "later": True} for name, by in names.items() if "of" in by]
    concepts = []
    for entry in entries:
        more = names.get(entry["name"], {})
        foreign = tuple(wording for language, wordings in more.items() if language not in ("of", "en") for wording in wordings)
        also = tuple(entry.get("also", ()))
        of, share, later = entry.get("of"), entry.get("share", 0.0), entry.get("later", False)
        concepts.append(Concept(entry["name"], of, share, also, tuple(more.get("en", ())), foreign, later))
    fillers, prepositions = ([word for of in added[what].values() for word in of] for what in ("fillers", "prepositions"))
    return Vocabulary(
        concepts, fixed["fillers"] + fillers, fixed["prepositions"] + prepositions, fixed["not_misspellings"] + added["not_misspellings"]
    )


def instruments(classes: Sequence[str]) -> list[int]:
    """Indices of the classes that are instruments, by any wording."""
    return [index for index, name in enumerate(classes) if surgical_vocabulary().is_a(name, "instrument")]


def split_negatives(text: str) -> tuple[str, tuple[str, ...]]:
    """What is wanted, and each thing that is not, as they were typed.

    `"tool, not grasper or scissors"` → `("tool,", ("grasper", "scissors"))`; either may be empty.
    Negations of all languages in `names.json` are understood.
    """
    negation, separator = _patterns()
    wanted, *excluded = negation.split(text)
    things = [thing.strip() for part in excluded for thing in separator.split(part)]
    return wanted.strip(), tuple(thing for thing in things if thing)


@lru_cache(maxsize=1)
def _patterns() -> tuple[re.Pattern[str], re.Pattern[str]]:
    data = read_json("names.json")
    negations = [word for of_language in data["negations"].values() for word in of_language]
    return re.compile(any_of(negations), re.IGNORECASE), re.compile(f"[,;，、；]|{any_of(data['separators'])}", re.IGNORECASE)


def any_of(wordings: list[str]) -> str:
    """A pattern for any of them, the longest first; a Chinese one may stand inside of a word."""
    longest = sorted(wordings, key=len, reverse=True)
    return "|".join(re.escape(word) if re.match(f"[{HAN}]", word) else rf"(?<!\w){re.escape(word)}(?!\w)" for word in longest)


def read_json(name: str) -> Any:
    """A file of words beside this one."""
    return json.loads(files("degense.engine.vocabulary").joinpath(name).read_text(encoding="utf-8"))
