"""The points that are followed: part of the session, edited through its undo stack. No Qt."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from degense.app.session.state import PersistentState
from degense.app.session.undo import UndoStack
from degense.engine.errors import RunError, what_is_wrong

MOST_POINTS = 10_000
Query = tuple[int, float, float]  # frame, x, y


class Point(NamedTuple):
    """A point; `queries`, ordered by frame, say where it was clicked and where it was corrected by hand."""

    number: int
    queries: tuple[Query, ...]


class TrackedPoints(PersistentState):
    """The points of a session."""

    def __init__(self, undo: UndoStack) -> None:
        super().__init__()
        self._undo = undo
        self.points: tuple[Point, ...] = ()

    def put(self, frame: int, x: float, y: float, number: int | None = None) -> None:
        """Let a point, or a new one, be at a pixel position in a frame, and be followed from there on."""
        points = {point.number: point for point in self.points}
        if number is None:
            number = max(points, default=0) + 1
            points[number] = Point(number, ())
        queries = {query[0]: query for query in points[number].queries} | {frame: (frame, x, y)}
        points[number] = Point(number, tuple(sorted(queries.values())))
        self._edit(f"Set point {number} in frame {frame}", tuple(points.values()))

    def remove(self, point: Point) -> None:
        self._edit(f"Remove point {point.number}", tuple(other for other in self.points if other != point))

    def remove_all(self) -> None:
        self._edit("Remove all points", ())

    def _edit(self, name: str, points: tuple[Point, ...]) -> None:
        self._undo.do(name, self._restore, self.points, points)

    def _restore(self, points: tuple[Point, ...]) -> None:
        self.points = points
        self.changed.emit(None)

    def clear(self) -> None:
        self._restore(())

    def to_json(self) -> Any:
        return self.points

    def from_json(self, data: Any, source: str) -> None:
        try:
            points = tuple(Point(int(k), tuple(sorted((int(t), float(x), float(y)) for t, x, y in queries))) for k, queries in data)
            places = [place for point in points for query in point.queries for place in query]
            if len(points) > MOST_POINTS or not all(point.queries for point in points) or not np.isfinite(places).all():
                raise ValueError(f"not up to {MOST_POINTS} points")
        except (TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not hold points to follow ({what_is_wrong(error)}).") from error
        self._restore(points)
