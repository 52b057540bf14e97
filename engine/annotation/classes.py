"""Label classes: names and colours, and two lists of them merged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

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


def merged(own: Sequence[LabelClass], others: Sequence[LabelClass]) -> tuple[tuple[LabelClass, ...], np.ndarray]:
    """All classes, `own` first; and what each value of the others' label maps is among them, uint8 [256].

    Classes of the same name, whatever its case, are the same. DegenseError when there are more than a label map holds.
    """
    classes = list(own)
    index = {kind.name.casefold(): number for number, kind in enumerate(classes)}
    table = np.full(256, UNLABELLED, np.uint8)
    for value, kind in enumerate(others):
        if kind.name.casefold() not in index:
            index[kind.name.casefold()] = len(classes)
            classes.append(kind)
            check_classes(classes)
        table[value] = index[kind.name.casefold()]
    return tuple(classes), table
