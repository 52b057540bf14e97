"""Questions about masks: a small grammar of relations in space and time."""

from degense.engine.vocabulary.questions.expressions import (
    AllOf,
    AnyOf,
    ButNot,
    Expression,
    Extreme,
    Moments,
    Noun,
    Question,
    Related,
    Relation,
    heads,
    nouns,
    nouns_of,
)
from degense.engine.vocabulary.questions.parser import read_question

__all__ = [
    "AllOf",
    "AnyOf",
    "ButNot",
    "Expression",
    "Extreme",
    "Moments",
    "Noun",
    "Question",
    "Related",
    "Relation",
    "heads",
    "nouns",
    "nouns_of",
    "read_question",
]
