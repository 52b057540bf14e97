"""One stack of named, undoable edits over immutable states."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from app.signal import Signal

State = TypeVar("State")


@dataclass(frozen=True)
class Edit(Generic[State]):
    """One step from `before` to `after`. Edits with the same `key` that follow each other closely are one step (a slider drag)."""

    name: str
    before: State
    after: State
    key: str | None = None
    made: float = 0.0


class UndoStack(Generic[State]):
    """A list of edits with a cursor. It keeps states, not callbacks: undoing is restoring, so an edit cannot undo only half of itself.

    Parameters
    ----------
    restore : callable
        Makes a state the current one.
    limit : int
        Edits kept; the oldest go first.
    merge_seconds : float
        Pause after which an edit with the same key starts a new step.
    """

    def __init__(
        self, restore: Callable[[State], None], limit: int = 500, merge_seconds: float = 1.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.changed: Signal[[]] = Signal()
        self._restore, self._limit, self._merge_seconds, self._clock = restore, limit, merge_seconds, clock
        self._edits: list[Edit[State]] = []
        self._cursor = 0

    @property
    def undo_name(self) -> str | None:
        """What undo would take back; None when there is nothing."""
        return self._edits[self._cursor - 1].name if self._cursor else None

    @property
    def redo_name(self) -> str | None:
        """What redo would bring again; None when there is nothing."""
        return self._edits[self._cursor].name if self._cursor < len(self._edits) else None

    def push(self, name: str, before: State, after: State, key: str | None = None) -> None:
        """Record an edit that has been made; what had been undone is forgotten."""
        now = self._clock()
        del self._edits[self._cursor :]
        last = self._edits[-1] if self._edits else None
        if last is not None and key is not None and last.key == key and now - last.made <= self._merge_seconds:
            self._edits[-1] = replace(last, name=name, after=after, made=now)
        else:
            self._edits.append(Edit(name, before, after, key, now))
        del self._edits[: -self._limit]
        self._cursor = len(self._edits)
        self.changed.emit()

    def undo(self) -> str | None:
        """Take the last edit back; its name, or None when there was none."""
        if not self._cursor:
            return None
        edit = self._edits[self._cursor - 1]
        self._restore(edit.before)
        self._cursor -= 1
        self.changed.emit()
        return edit.name

    def redo(self) -> str | None:
        """Bring the next undone edit again; its name, or None when there was none."""
        if self._cursor == len(self._edits):
            return None
        edit = self._edits[self._cursor]
        self._restore(edit.after)
        self._cursor += 1
        self.changed.emit()
        return edit.name

    def clear(self) -> None:
        self._edits.clear()
        self._cursor = 0
        self.changed.emit()
