"""What an index keeps of the masks of one frame: objects, their places, and the relations between them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Literal

import cv2
import numpy as np

from degense.engine.semantics.relations import CONTACT, ENCLOSED, NEAR, filled, gap_to, hull

#: What a column holds. Of each frame: `counts`, the objects of a thing, `pixels` and `middle` of its mask, `confidence`, `displacement`
#: at `PERCENTILES`, and `overlap`, the pixels that two masks share. Of each object: `sizes` and `centres`, pixels, and whether it stands in
#: a relation.
Kind = Literal[
    "counts", "pixels", "middle", "confidence", "displacement", "overlap", "sizes", "centres", "touching", "near", "inside", "between"
]
#: (kind, thing, *other things). The others of `between` may be two classes, in the order of the alphabet.
Key = tuple[str, ...]
PERCENTILES = (50, 90, 99)


def frame_facts(masks: Mapping[str, np.ndarray], classes: Sequence[str]) -> dict[Key, np.ndarray]:
    """The facts of one frame from masks bool [H, W] by name; arrays of a number, or of one for each object, in the order of `related`.

    Whatever holds for no object is left out. Between two things: of two `classes` only.
    """
    facts: dict[Key, np.ndarray] = {}
    objects = {name: Objects(mask) for name, mask in masks.items() if mask.any()}
    for name, of_name in objects.items():
        facts |= {("counts", name): np.array([len(of_name.sizes)]), ("pixels", name): np.array([of_name.sizes.sum()])}
        facts["middle", name] = np.average(of_name.centres, 0, of_name.sizes)[None]
        facts |= {("sizes", name): of_name.sizes, ("centres", name): of_name.centres}
    for to in objects:
        gaps, diagonal = gap_to(masks[to]), math.hypot(*masks[to].shape)
        around, spanned = filled(masks[to]), hull(masks[to])
        for name, of_name in objects.items():
            nearest = of_name.nearest(gaps)
            _add(facts, ("touching", name, to), nearest <= CONTACT * diagonal)
            _add(facts, ("near", name, to), nearest <= NEAR * diagonal)
            _add(facts, ("inside", name, to), of_name.mostly_in(around))
            _add(facts, ("between", name, to), of_name.mostly_in(spanned))
            if name < to:
                _add(facts, ("overlap", name, to), np.array([np.count_nonzero(masks[name] & masks[to])]))
    return facts | _between_two(masks, objects, classes, facts)


def _between_two(
    masks: Mapping[str, np.ndarray], objects: Mapping[str, Objects], classes: Sequence[str], facts: Mapping[Key, np.ndarray]
) -> dict[Key, np.ndarray]:
    """`between` two classes; where only one of them is there, between that one."""
    found: dict[Key, np.ndarray] = {}
    for one, other in combinations(classes, 2):
        there = [name for name in (one, other) if name in objects]
        spanned = hull(masks[one] | masks[other]) if len(there) == 2 else None
        for name, of_name in objects.items() if there else ():
            known = facts.get(("between", name, there[0])) if spanned is None else of_name.mostly_in(spanned)
            if known is not None:
                _add(found, ("between", name, *sorted((one, other))), known)
    return found


def _add(facts: dict[Key, np.ndarray], key: Key, values: np.ndarray) -> None:
    if values.any():
        facts[key] = values


class Objects:
    """The connected pieces of a mask bool [H, W] that is not empty."""

    def __init__(self, mask: np.ndarray) -> None:
        _, numbers, boxes, centres = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
        self.sizes, self.centres = boxes[1:, cv2.CC_STAT_AREA].astype(np.int64), centres[1:]  # [n], [n, 2] as (x, y)
        inside = np.flatnonzero(numbers)
        self._pixels = inside[numbers.ravel()[inside].argsort(kind="stable")]  # of the first object, of the second, …
        self._starts = np.concatenate([[0], self.sizes.cumsum()[:-1]])

    def nearest(self, distances: np.ndarray) -> np.ndarray:
        """The smallest of distances [H, W] in each object, [n]."""
        return np.minimum.reduceat(distances.ravel()[self._pixels], self._starts)

    def mostly_in(self, region: np.ndarray) -> np.ndarray:
        """Whether the share `ENCLOSED` of each object lies in a region bool [H, W], bool [n]."""
        return np.add.reduceat(region.ravel()[self._pixels].astype(np.int64), self._starts) >= ENCLOSED * self.sizes
