"""Visual examples in a prompt: "liver @12:80,60" is the liver and whatever looks like pixel (80, 60) of frame 12."""

from __future__ import annotations

import re
from dataclasses import dataclass

from degense.engine.errors import PromptError
from degense.engine.vocabulary.concepts import split_negatives

_EXAMPLE = re.compile(r"@\s*(\d{1,7}):(\d{1,6}),(\d{1,6})(?!\d)")


@dataclass(frozen=True)
class Example:
    """A place in the surgeon's picture, whole pixels."""

    frame: int
    x: int
    y: int

    def __str__(self) -> str:
        return f"@{self.frame}:{self.x},{self.y}"


def split_examples(text: str) -> tuple[str, tuple[Example, ...]]:
    """The words of a plain prompt, and its examples. PromptError for one among what is excluded, and for an @ that marks no place."""
    examples = tuple(dict.fromkeys(Example(*map(int, place.groups())) for place in _EXAMPLE.finditer(text)))
    words = " ".join(_EXAMPLE.sub(" ", text).split()) if examples else text
    if re.search(r"@\s*\d", words):
        raise PromptError(f"'{text}' has an @ without a place; write an example as @FRAME:X,Y, such as @12:80,60.")
    if examples and any("@" in other for other in split_negatives(text)[1]):
        raise PromptError(f"'{text}' has an example of what is not meant; put examples before the negation.")
    return words, examples
