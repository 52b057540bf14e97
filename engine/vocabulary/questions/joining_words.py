"""The names in a text, and the words that join them: "and", "left of", "before"."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from degense.engine.vocabulary.concepts import any_of, read_json, surgical_vocabulary
from degense.engine.vocabulary.spelling import key, words

QUOTED = '["“„«][^"“”»]*["“”»]'


@dataclass(frozen=True)
class Token:
    kind: str  # "name", a parenthesis, "not", or a key of `joining.json`
    start: int  # where it stands in the text
    end: int


def tokens_of(text: str, names: tuple[str, ...]) -> list[Token]:
    """Names and joining words in the order of the text. `names` and wordings of the vocabulary that hold such words stay whole."""
    if key(text) in map(key, names):
        return [Token("name", 0, len(text))]
    whole = [found.span() for found in _unbroken(names).finditer(text)]
    found: list[Token] = []
    at = 0
    for match in _joining().finditer(text):
        if not any(start < match.end() and match.start() < end for start, end in whole):
            found += [*_name(text, at, match.start()), Token(_meanings().get(match.group().lower(), match.group()), *match.span())]
            at = match.end()
    found += _name(text, at, len(text))
    kinds = ["", *(token.kind for token in found), ""]
    idle = [kind in ("and", "or") and not (kinds[i - 1] and kinds[i + 1] not in ("", "not")) for i, kind in enumerate(kinds)][1:-1]
    return [token for token, joins_nothing in zip(found, idle, strict=True) if not joins_nothing]  # "find and show the liver", "and no"


def _name(text: str, start: int, end: int) -> Iterator[Token]:
    """What stands between two joining words; nothing where it says nothing ("is", "that the")."""
    if any(word not in surgical_vocabulary().fillers for word in words(text[start:end])):
        yield Token("name", start, end)


@lru_cache(maxsize=1)
def _meanings() -> dict[str, str]:
    """What each joining word stands for; accents may be left out."""
    kinds = {kind: by for kind, by in read_json("joining.json").items() if kind != "about"} | {"not": read_json("names.json")["negations"]}
    meanings = {word.lower(): kind for kind, by in kinds.items() for of_language in by.values() for word in of_language}
    return {_without_accents(word): kind for word, kind in meanings.items()} | meanings


@lru_cache(maxsize=1)
def _joining() -> re.Pattern[str]:
    return re.compile(f"[()]|(?<!-)(?:{any_of(list(_meanings()))})(?!-)", re.IGNORECASE)  # "hem-o-lok" joins nothing


@lru_cache(maxsize=64)
def _unbroken(names: tuple[str, ...]) -> re.Pattern[str]:
    """Quotes, and names that hold a joining word ("kidney under fat")."""
    holding = [*(name for name in names if _joining().search(name)), *_holding()]
    return re.compile("|".join([QUOTED, *([any_of(holding)] if holding else [])]), re.IGNORECASE)


@lru_cache(maxsize=1)
def _holding() -> list[str]:
    """Wordings of the vocabulary that hold a joining word."""
    wordings = [wording for concept in surgical_vocabulary().concepts for wording in concept.wordings]
    return [wording for wording in wordings if _joining().search(wording)]


def _without_accents(word: str) -> str:
    return "".join(letter for letter in unicodedata.normalize("NFKD", word) if not unicodedata.combining(letter))
