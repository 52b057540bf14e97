"""Two lists of classes as one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from degense.engine.annotation.classes import LabelClass, check_classes
from degense.engine.clip import UNLABELLED


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
