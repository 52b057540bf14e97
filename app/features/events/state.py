"""Moments of the clip that are worth a note: part of the session, edited through its undo stack. No Qt."""

from __future__ import annotations

from typing import Any

from degense.app.session.state import PersistentState
from degense.app.session.undo import UndoStack
from degense.engine.errors import RunError, what_is_wrong

MOST_EVENTS, LONGEST_NOTE = 1000, 500


class Events(PersistentState):
    """Notes by frame; at most one a frame, ordered by frame."""

    def __init__(self, undo: UndoStack) -> None:
        super().__init__()
        self._undo = undo
        self.notes: dict[int, str] = {}

    def put(self, frame: int, note: str = "") -> None:
        """Mark a frame, or change its note."""
        note = " ".join(note.split())[:LONGEST_NOTE]
        if self.notes.get(frame) != note:
            self._edit(f"{'Note' if frame in self.notes else 'Event'} in frame {frame}", {**self.notes, frame: note})

    def remove(self, frame: int) -> None:
        if frame in self.notes:
            self._edit(f"Remove the event in frame {frame}", {other: note for other, note in self.notes.items() if other != frame})

    def next_to(self, frame: int, step: int) -> int | None:
        """The marked frame after (`step` 1) or before (−1) a frame; None when there is none."""
        found = [other for other in self.notes if (other - frame) * step > 0]
        return min(found, key=lambda other: abs(other - frame), default=None)

    def _edit(self, name: str, notes: dict[int, str]) -> None:
        self._undo.do(name, self._restore, self.notes, dict(sorted(notes.items())))

    def _restore(self, notes: dict[int, str]) -> None:
        self.notes = notes
        self.changed.emit(None)

    def clear(self) -> None:
        self._restore({})

    def to_json(self) -> Any:
        return list(self.notes.items())

    def from_json(self, data: Any, source: str) -> None:
        try:
            notes = {int(frame): str(note)[:LONGEST_NOTE] for frame, note in data}
            if len(notes) > MOST_EVENTS or any(frame < 0 for frame in notes):
                raise ValueError(f"not up to {MOST_EVENTS} frames with notes")
        except (TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not hold events ({what_is_wrong(error)}).") from error
        self._restore(dict(sorted(notes.items())))
