"""How time runs: the part that is repeated, and what happens at its end."""

from __future__ import annotations

from typing import Any, Literal, get_args

from degense.app.session.persistent_state import PersistentState
from degense.engine.errors import RunError

LoopMode = Literal["once", "loop", "bounce"]


class Playback(PersistentState):
    """Saved with the session; a change of it is no work that would be missed.

    Attributes
    ----------
    first, last : int or None
        The first and last frame that are played; None for those of the sequence.
    mode : {"once", "loop", "bounce"}
    """

    counts = False

    def __init__(self) -> None:
        super().__init__()
        self.clear()

    def clear(self) -> None:
        self.first: int | None = None
        self.last: int | None = None
        self.mode: LoopMode = "loop"

    @property
    def whole(self) -> bool:
        """Whether all frames are played."""
        return self.first is None and self.last is None

    def start_at(self, frame: int) -> None:
        """Play from here on; an end that lies before is forgotten."""
        self.first = frame
        if self.last is not None and self.last <= frame:
            self.last = None
        self.changed.emit(None)

    def end_at(self, frame: int) -> None:
        """Play up to here; a start that lies behind is forgotten."""
        self.last = frame
        if self.first is not None and self.first >= frame:
            self.first = None
        self.changed.emit(None)

    def play_all(self) -> None:
        self.first = self.last = None
        self.changed.emit(None)

    def set_mode(self, mode: LoopMode) -> None:
        self.mode = mode
        self.changed.emit(None)

    def to_json(self) -> Any:
        return {"first": self.first, "last": self.last, "mode": self.mode}

    def from_json(self, data: Any, source: str) -> None:
        try:
            first, last = (None if data[name] is None else max(0, int(data[name])) for name in ("first", "last"))
            if data["mode"] not in get_args(LoopMode) or (first is not None and last is not None and last <= first):
                raise ValueError("no way to play")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not say how to play ({error}).") from error
        self.first, self.last, self.mode = first, last, data["mode"]
