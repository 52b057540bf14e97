"""What a question asks, as a tree: masks in a frame, and which frames count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeGuard, get_args

Relation = Literal["left of", "right of", "above", "below", "touching", "near", "inside", "between"]
Time = Literal["when", "when not", "before", "after", "first", "last", "largest", "smallest"]


@dataclass(frozen=True)
class Noun:
    """A plain prompt: what a text encoder reads."""

    text: str


@dataclass(frozen=True)
class AnyOf:
    """What either has."""

    parts: tuple[Expression, ...]


@dataclass(frozen=True)
class AllOf:
    """What any has, where all are there at once."""

    parts: tuple[Expression, ...]


@dataclass(frozen=True)
class ButNot:
    """The pixels of `what` without those of `other`."""

    what: Expression
    other: Expression


@dataclass(frozen=True)
class Related:
    """The objects of `what` that stand in a relation to `to`, or, when negated, do not."""

    what: Expression
    relation: Relation
    to: Expression
    negated: bool = False


@dataclass(frozen=True)
class Extreme:
    """The largest or the smallest object in each frame."""

    what: Expression
    largest: bool


Expression = Noun | AnyOf | AllOf | ButNot | Related | Extreme


@dataclass(frozen=True)
class Moments:
    """Keeps some of the frames: `when`, `before` and `after` by those of another question."""

    kind: Time
    of: Question | None = None


@dataclass(frozen=True)
class Question:
    """A mask in each frame, and which frames count."""

    what: Expression
    times: tuple[Moments, ...] = ()  # applied in order
    absent: bool = False  # the frames without the mask count: "when is no grasper"

    @property
    def plain(self) -> bool:
        """Whether it is no more than a prompt."""
        return isinstance(self.what, Noun) and not self.times and not self.absent


def nouns_of(question: Question) -> tuple[str, ...]:
    """All nouns of a question, each once, those of its times last."""
    of_times = (text for time in question.times if time.of is not None for text in nouns_of(time.of))
    return tuple(dict.fromkeys((*nouns(question.what), *of_times)))


def heads(expression: Expression) -> tuple[str, ...]:
    """The nouns whose pixels the mask of an expression holds."""
    if isinstance(expression, Noun):
        return (expression.text,)
    parts = expression.parts if isinstance(expression, (AnyOf, AllOf)) else (expression.what,)
    return tuple(dict.fromkeys(text for part in parts for text in heads(part)))


def nouns(expression: Expression) -> tuple[str, ...]:
    """All nouns of an expression, each once."""
    if isinstance(expression, Noun):
        return (expression.text,)
    parts = expression.parts if isinstance(expression, (AnyOf, AllOf)) else tuple(vars(expression).values())
    return tuple(dict.fromkeys(text for part in parts if isinstance(part, Expression) for text in nouns(part)))


def only_nouns(expression: Expression) -> bool:
    """Whether it is a noun or a list of nouns."""
    return isinstance(expression, Noun) or (isinstance(expression, (AnyOf, AllOf)) and all(map(only_nouns, expression.parts)))


def is_relation(kind: str | None) -> TypeGuard[Relation]:
    return kind in get_args(Relation)
