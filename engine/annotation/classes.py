"""Label classes: names and colours."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from degense.engine.clip import UNLABELLED
from degense.engine.colour_maps import CLASS_COLOURS
from degense.engine.errors import DegenseError

Colour = tuple[int, int, int]
LONGEST_NAME = 200


@dataclass(frozen=True)
class LabelClass:
    """What a value of a label map means; its index in the list of classes is the value."""

    name: str
    colour: Colour


def default_colour(index: int) -> Colour:
    """Colours that colour-blind readers tell apart; they repeat after the last."""
    return CLASS_COLOURS[index % len(CLASS_COLOURS)]


def named_classes(names: Iterable[str]) -> tuple[LabelClass, ...]:
    """Classes in the default colours."""
    return tuple(LabelClass(name, default_colour(index)) for index, name in enumerate(names))


def check_classes(classes: Sequence[LabelClass]) -> None:
    """DegenseError when there are too many classes, or a name is empty, too long or twice there."""
    if len(classes) > UNLABELLED:
        raise DegenseError(f"There are {len(classes)} classes, but a label map holds at most {UNLABELLED}.")
    names = [kind.name.casefold() for kind in classes]
    for kind, name in zip(classes, names, strict=True):
        if not name.strip() or len(name) > LONGEST_NAME or not kind.name.isprintable():
            raise DegenseError(f"A class needs a name of 1 to {LONGEST_NAME} letters.")
        if names.count(name) > 1:
            raise DegenseError(f"There is a class “{kind.name}” already.")
