"""Questions answered from columns, with the masks that an opened run would have: the same frames and the same areas.

What is kept are objects and how they stand to whole things, not pixels. So an index cannot answer, and `NeedsRun` says why:

- relations of, and the largest of, several names in parentheses: their masks may join to other objects;
- touching, near, inside, between with something that is itself chosen by a relation; inside several names; between more than two classes,
  or kinds;
- names that are no class of a run whose encoder knows more, kinds without a name ("tool, not grasper" of three), visual examples;
- lists and `not` where more than two masks share a pixel, or a mask that is chosen by a relation shares pixels with another.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from degense.engine.archive.columns import Columns
from degense.engine.archive.names import NeedsRun
from degense.engine.semantics.relations import DIRECTIONS, towards
from degense.engine.vocabulary.questions import AllOf, AnyOf, ButNot, Expression, Extreme, Noun, Related

PARENTHESES = "A relation among several names in parentheses is known only to the run."
SHARED = "The masks of these names share pixels, and which is known only to the run."
#: A thing and which of its objects, bool [N]; None for all.
Chosen = tuple[str, np.ndarray | None]


class Answers:
    """Areas of expressions in all frames of some columns; each is computed once."""

    def __init__(self, columns: Columns) -> None:
        self.columns = columns
        self._areas: dict[Expression, np.ndarray] = {}

    def area(self, expression: Expression) -> np.ndarray:
        """Pixels of the mask in each frame, [F]. `NeedsRun` where the columns do not tell, PromptError for a name nobody knows."""
        if expression not in self._areas:
            self._areas[expression] = self._area(expression)
        return self._areas[expression]

    def _area(self, expression: Expression) -> np.ndarray:
        if isinstance(expression, (AnyOf, AllOf)):
            pieces = self._pieces(expression.parts)
            total = np.sum([self._size(piece) for piece in pieces], 0, dtype=np.float64) if pieces else np.zeros(self.columns.frames)
            total = total - self._shared_by(pieces)
            there = [self.area(part) > 0 for part in expression.parts] if isinstance(expression, AllOf) else []
            return total * np.logical_and.reduce(there) if there else total
        if isinstance(expression, ButNot):
            what, others = self._pieces([expression.what]), self._pieces([expression.other])
            apart = len(what) == 1 and what[0][1] is None and all(name != what[0][0] for name, _ in others)
            if apart and not self._shared_by(others).any():
                shared = [self._shared(what[0], other) for other in others]
                return self._size(what[0]) - np.sum([pixels for pixels in shared if pixels is not None], 0, dtype=np.float64)
        chosen = self._objects(expression)
        return np.zeros(self.columns.frames) if chosen is None else self._size(chosen)

    def _size(self, chosen: Chosen) -> np.ndarray:
        """Pixels in each frame, [F]."""
        thing, keep = chosen
        if keep is None:
            return self.columns.pixels(thing)
        return np.bincount(self.columns.frame_of(thing)[keep], self.columns.sizes(thing)[keep], self.columns.frames)

    def _shared_by(self, pieces: Sequence[Chosen]) -> np.ndarray:
        """Pixels that two of some masks of different things share, in each frame."""
        total, sharing = np.zeros(self.columns.frames), np.zeros(self.columns.frames, np.uint8)
        for one, other in combinations(pieces, 2):
            if (shared := self._shared(one, other)) is not None:
                total += shared
                sharing += shared > 0
        if (sharing > 1).any():
            raise NeedsRun(SHARED)
        return total

    def _shared(self, one: Chosen, other: Chosen) -> np.ndarray | None:
        """Pixels that two masks of different things share in each frame; None for none."""
        shared = self.columns.overlap(one[0], other[0])
        if shared is not None and not (one[1] is None and other[1] is None):
            raise NeedsRun(SHARED)
        return shared

    def _pieces(self, parts: Sequence[Expression]) -> list[Chosen]:
        """What a list of expressions holds, each thing once."""
        found: dict[str, np.ndarray | None] = {}
        for part in parts:
            inner = self._pieces(part.parts) if isinstance(part, AnyOf) else [self._objects(part)]
            for thing, keep in filter(None, inner):
                known = found.get(thing, keep)
                found[thing] = None if keep is None or known is None else keep | known
        return list(found.items())

    def _objects(self, expression: Expression) -> Chosen | None:
        """The objects that an expression of one thing keeps; None where the runs hold nothing of that name."""
        if isinstance(expression, Noun):
            thing = self._meant(expression.text)
            return None if thing is None else (thing, None)
        if isinstance(expression, AnyOf):
            pieces = self._pieces(expression.parts)
            if len(pieces) > 1:
                raise NeedsRun(PARENTHESES)
            return pieces[0] if pieces else None
        if isinstance(expression, AllOf):
            raise NeedsRun(PARENTHESES)
        chosen = self._objects(expression.what)
        if chosen is None:
            return None
        thing, before = chosen
        if isinstance(expression, Extreme):
            return thing, self._extreme(thing, before, expression.largest)
        if isinstance(expression, ButNot):
            return thing, self._without(chosen, self._pieces([expression.other]))
        holds = self._related(thing, expression)
        keep = ~holds if expression.negated else holds
        return thing, keep if before is None else keep & before

    def _without(self, chosen: Chosen, others: Sequence[Chosen]) -> np.ndarray | None:
        """The objects of a thing that none of some other masks takes pixels from."""
        thing, keep = chosen
        for other in others:
            if other[0] == thing:
                left = np.zeros(len(self.columns.sizes(thing)), bool) if other[1] is None else ~other[1]
                keep = left if keep is None else keep & left
            elif self.columns.overlap(thing, other[0]) is not None:
                raise NeedsRun(SHARED)
        return keep

    def _meant(self, text: str) -> str | None:
        return self.columns.things.meant(text)

    def _related(self, thing: str, expression: Related) -> np.ndarray:
        """Which objects of a thing stand in the relation, bool [N]."""
        relation, to = expression.relation, expression.to
        if relation in DIRECTIONS:
            return self._direction(thing, DIRECTIONS[relation], to)
        parts = to.parts if isinstance(to, AnyOf) else (to,)
        if not all(isinstance(part, Noun) for part in parts):
            raise NeedsRun(f"'{relation}' something that is itself chosen by a relation is known only to the run.")
        found = [self._meant(part.text) for part in parts if isinstance(part, Noun)]
        others = list(dict.fromkeys(name for name in found if name is not None))
        if relation in ("touching", "near") or len(others) <= 1:
            held = [self.columns.holds(relation, thing, other) for other in others]  # type: ignore[arg-type]
            return np.logical_or.reduce(held) if held else np.zeros(len(self.columns.sizes(thing)), bool)
        if relation == "inside" or len(others) > 2 or not {*others} <= {*self.columns.things.classes}:
            raise NeedsRun(f"'{relation}' {' and '.join(others)} is known only to the run.")
        return self.columns.holds("between", thing, *sorted(others))

    def _direction(self, thing: str, direction: tuple[int, int], to: Expression) -> np.ndarray:
        """From the middle of all that `to` holds in the frame."""
        pieces = self._pieces([to])
        if self._shared_by(pieces).any():
            raise NeedsRun(SHARED)
        middles = [self._middle(piece) for piece in pieces]
        weights = [self._size(piece) for piece in pieces]
        if len(pieces) == 1:
            middle, weight = middles[0], weights[0]
        else:
            weight, total = np.zeros(self.columns.frames), np.zeros((self.columns.frames, 2))
            for of_piece, size in zip(middles, weights, strict=True):
                weight, total = weight + size, total + of_piece * size[:, None]
            middle = total / np.maximum(weight, 1)[:, None]
        frames = self.columns.frame_of(thing)
        return (weight > 0)[frames] & towards(self.columns.centres(thing) - middle.take(frames, 0), direction)

    def _middle(self, chosen: Chosen) -> np.ndarray:
        """Of a mask in each frame, [F, 2]."""
        thing, keep = chosen
        if keep is None:
            return self.columns.middle(thing)
        frames, sizes = self.columns.frame_of(thing)[keep], self.columns.sizes(thing)[keep].astype(np.float64)
        sums = [np.bincount(frames, sizes * places, self.columns.frames) for places in self.columns.centres(thing)[keep].T]
        return np.stack(sums, 1) / np.maximum(np.bincount(frames, sizes, self.columns.frames), 1)[:, None]

    def _extreme(self, thing: str, keep: np.ndarray | None, largest: bool) -> np.ndarray:
        """In each frame the first of the largest, or smallest, objects of those that are kept."""
        rows = np.arange(len(self.columns.sizes(thing))) if keep is None else np.flatnonzero(keep)
        chosen = np.zeros(len(self.columns.sizes(thing)), bool)
        if len(rows):
            frames, sizes = self.columns.frame_of(thing)[rows], self.columns.sizes(thing)[rows].astype(np.int64)
            sizes = sizes if largest else -sizes
            begins = np.flatnonzero(np.diff(frames, prepend=-1))
            most = np.repeat(np.maximum.reduceat(sizes, begins), np.diff(begins, append=len(rows)))
            candidates = np.flatnonzero(sizes == most)
            chosen[rows[candidates[np.diff(frames[candidates], prepend=-1) > 0]]] = True
        return chosen
