"""What a prompt does not mean: "liver, not gallbladder"."""

from __future__ import annotations

import json
import re
from functools import lru_cache
from importlib.resources import files

from degense.engine.semantics.text.spelling import HAN


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
    data = json.loads(files("degense.engine.semantics.text").joinpath("names.json").read_text(encoding="utf-8"))
    negations = [word for of_language in data["negations"].values() for word in of_language]
    return re.compile(_any_of(negations), re.IGNORECASE), re.compile(f"[,;，、；]|{_any_of(data['separators'])}", re.IGNORECASE)


def _any_of(wordings: list[str]) -> str:
    """A pattern for any of them, the longest first; a Chinese one may stand inside of a word."""
    longest = sorted(wordings, key=len, reverse=True)
    return "|".join(re.escape(word) if re.match(f"[{HAN}]", word) else rf"(?<!\w){re.escape(word)}(?!\w)" for word in longest)
