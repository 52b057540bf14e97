"""What is measured: part of the session, edited through its undo stack. No Qt."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from degense.app.session.state import PersistentState
from degense.app.session.undo import UndoStack
from degense.engine.errors import RunError, what_is_wrong

Kind = Literal["distance", "path", "area"]
#: The fewest and the most corners of a kind; None: any number.
CORNERS: dict[Kind, tuple[int, int | None]] = {"distance": (2, 2), "path": (2, None), "area": (3, None)}
MOST_MEASURES, MOST_CORNERS = 200, 500


class Measure(NamedTuple):
    """Something that is measured; `corners` were clicked in `frame` and move with the material from there."""

    number: int
    kind: Kind
    frame: int
    corners: tuple[tuple[float, float], ...]  # pixels

    @property
    def title(self) -> str:
        return f"{self.kind.capitalize()} {self.number}"


class Measures(PersistentState):
    """The measures of a session."""

    def __init__(self, undo: UndoStack) -> None:
        super().__init__()
        self._undo = undo
        self.measures: tuple[Measure, ...] = ()

    def add(self, kind: Kind, frame: int, corners: tuple[tuple[float, float], ...]) -> None:
        number = max((measure.number for measure in self.measures), default=0) + 1
        added = Measure(number, kind, frame, corners)
        self._edit(f"Measure {added.title.lower()}", (*self.measures, added))

    def remove(self, measure: Measure) -> None:
        self._edit(f"Remove {measure.title.lower()}", tuple(other for other in self.measures if other != measure))

    def _edit(self, name: str, measures: tuple[Measure, ...]) -> None:
        self._undo.do(name, self._restore, self.measures, measures)

    def _restore(self, measures: tuple[Measure, ...]) -> None:
        self.measures = measures
        self.changed.emit(None)

    def clear(self) -> None:
        self._restore(())

    def to_json(self) -> Any:
        return self.measures

    def from_json(self, data: Any, source: str) -> None:
        try:
            measures = tuple(_measure(*item) for item in data)
            if len(measures) > MOST_MEASURES:
                raise ValueError(f"more than {MOST_MEASURES}")
        except (TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not hold what was measured ({what_is_wrong(error)}).") from error
        self._restore(measures)


def _measure(number: Any, kind: Any, frame: Any, corners: Any) -> Measure:
    places = tuple((float(x), float(y)) for x, y in corners)
    if kind not in get_args(Kind) or not np.isfinite(places).all() or int(frame) < 0:
        raise ValueError(f"no measure: {kind!r}")
    fewest, most = CORNERS[kind]
    if not fewest <= len(places) <= (most or MOST_CORNERS):
        raise ValueError(f"{kind} with {len(places)} corners")
    return Measure(int(number), kind, int(frame), places)
