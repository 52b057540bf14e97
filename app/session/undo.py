"""One stack of named, undoable edits of everything that the user changes: views, prompts, masks, labels."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from degense.app.session.state import Signal

State = TypeVar("State")


@dataclass(frozen=True)
class Edit:
    """One step between two states."""

    name: str
    apply: Callable[[Any], object]  # puts a state in place: sets the view state, the pixels of a mask, the classes
    before: Any  # the two states; they are not changed later
    after: Any
    key: str | None = None  # edits of the same key and `apply` that follow each other closely are one step (a slider drag)
    size: int = 0  # bytes that the two states hold
    made: float = 0.0


class UndoStack:
    """A list of edits with a cursor. Edits hold states: undoing applies the state before, redoing the state after.

    Of the edits at most `limit` are kept, and so many as hold no more than `memory` bytes, but the last whatever its size. After a pause of
    `merge_seconds` an edit with the same key starts a new step.
    """

    def __init__(
        self, limit: int = 500, memory: int = 256 << 20, merge_seconds: float = 1.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.changed: Signal[[]] = Signal()  # the entries or the position
        self._limit, self._memory, self._merge_seconds, self._clock = limit, memory, merge_seconds, clock
        self._edits: list[Edit] = []
        self.position = 0  # how many of the entries are done

    @property
    def entries(self) -> tuple[str, ...]:
        """The names of all edits, the oldest first; those from `position` on are undone."""
        return tuple(edit.name for edit in self._edits)

    @property
    def size(self) -> int:
        return sum(edit.size for edit in self._edits)

    def set_memory(self, memory: int) -> None:
        self._memory = memory
        self._forget()

    @property
    def undo_name(self) -> str | None:
        """What undo would take back; None when there is nothing."""
        return self._edits[self.position - 1].name if self.position else None

    @property
    def redo_name(self) -> str | None:
        """What redo would bring again; None when there is nothing."""
        return self._edits[self.position].name if self.position < len(self._edits) else None

    def do(self, name: str, apply: Callable[[State], object], before: State, after: State, key: str | None = None, size: int = 0) -> None:
        """Apply a state and record the edit; nothing when it is the state before. `size` in bytes; see `Edit`."""
        if after != before:
            apply(after)
            self.record(name, apply, before, after, key, size)

    def record(
        self, name: str, apply: Callable[[State], object], before: State, after: State, key: str | None = None, size: int = 0
    ) -> None:
        """Record an edit that has been applied already (a stroke). What had been undone is forgotten."""
        now = self._clock()
        del self._edits[self.position :]
        last = self._edits[-1] if self._edits else None
        if last and key is not None and (last.key, last.apply) == (key, apply) and now - last.made <= self._merge_seconds:
            self._edits[-1] = replace(last, name=name, after=after, size=max(last.size, size), made=now)
        else:
            self._edits.append(Edit(name, apply, before, after, key, size, now))
        self.position = len(self._edits)
        self._forget()
        self.changed.emit()

    def _forget(self) -> None:
        """Let the oldest edits go until the rest fits. Edits that are undone stay: they are the newest."""
        while self.position and (len(self._edits) > self._limit or (self.size > self._memory and len(self._edits) > 1)):
            del self._edits[0]
            self.position -= 1

    def undo(self) -> str | None:
        """Take the last edit back; its name, or None when there was none."""
        name = self.undo_name
        self.go_to(self.position - 1)
        return name

    def redo(self) -> str | None:
        """Repeat the next undone edit; its name, or None when there was none."""
        name = self.redo_name
        self.go_to(self.position + 1)
        return name

    def go_to(self, position: int) -> None:
        """Undo or redo until `position` entries are done; numbers beyond the ends are clamped."""
        position = min(max(0, position), len(self._edits))
        while self.position != position:
            back = self.position > position
            edit = self._edits[self.position - back]
            edit.apply(edit.before if back else edit.after)
            self.position += -1 if back else 1
            self.changed.emit()

    def clear(self) -> None:
        self._edits.clear()
        self.position = 0
        self.changed.emit()
