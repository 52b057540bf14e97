"""What the areas of a session build on: signals without Qt, and states that are saved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, ParamSpec

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene

P = ParamSpec("P")


class Signal(Generic[P]):
    """Calls its slots in the order they were connected. A slot that raises stops the others."""

    def __init__(self) -> None:
        self._slots: list[Callable[P, object]] = []

    def connect(self, slot: Callable[P, object]) -> Callable[[], None]:
        """Call `slot` on each emit from now on. Returns the function that disconnects it (calling it twice is harmless)."""
        self._slots.append(slot)

        def disconnect() -> None:
            if slot in self._slots:
                self._slots.remove(slot)

        return disconnect

    def emit(self, *args: P.args, **kwargs: P.kwargs) -> None:
        for slot in tuple(self._slots):
            slot(*args, **kwargs)


@dataclass(frozen=True)
class Storing:
    """A state's own files, of one instant: `write` in any thread, while the state may change; then `done` in that of the state."""

    write: Callable[[], None]
    done: Callable[[], None]


class PersistentState:
    """The state of one area: the view, the annotations, the layout of the window. Subclasses need no Qt.

    `session.register(name, state)` makes it part of what is saved: it is cleared when something else is opened, read from the session
    file, written into it, and its changes between two saves go to the journal.
    """

    counts = True  # whether a change marks the session as unsaved and goes to the journal. Changes of the frame or camera do not

    def __init__(self) -> None:
        #: (record) after each change. `record` is a small JSON value from which `replay` makes the change again (a stroke); None stands for
        #: the whole `to_json()`, for states that are small.
        self.changed: Signal[[Any]] = Signal()

    def clear(self) -> None:
        """Return to the state in which nothing was done."""
        raise NotImplementedError

    def to_json(self) -> Any:
        """The whole state as JSON values."""
        raise NotImplementedError

    def from_json(self, data: Any, source: str) -> None:
        """Take the state that `to_json` wrote. RunError when the data is no such state; the sentence names `source`."""
        raise NotImplementedError

    def replay(self, record: Any, source: str) -> None:
        """Repeat a change from the journal. Errors as `from_json`."""
        self.from_json(record, source)

    def storing(self, folder: Path) -> Storing | None:
        """What is too large for the session file and is written beside it, before that file. The journal is empty from then on."""
        return None

    def read(self, folder: Path, scene: Scene | None, clip: Clip | None) -> Callable[[], None]:
        """Read what `storing` wrote of a run or clip, in any thread; then, in that of the state and before `from_json`, what is returned
        makes it the state. RunError when it is damaged. Nothing is read by default."""
        return lambda: None
