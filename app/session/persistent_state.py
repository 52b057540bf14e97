"""What the session holds and saves besides the look: one object per area, registered by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from degense.app.session.signal import Signal


class PersistentState:
    """An area's state: annotations, bookmarks, the layout of the window. Subclasses need no Qt.

    `session.register(name, part)` puts it into the session: it is emptied when something else is opened, filled from the run folder's
    session file, saved into it, and what changes between two saves goes to the journal.

    Attributes
    ----------
    counts : bool
        Whether a change of this part is work that would be missed: it marks the session as unsaved. Places (frame, camera) do not count.

    Signals
    -------
    changed(record)
        After each change. `record` is a small JSON value from which `replay` makes the change again (a stroke); None stands for the whole
        `to_json()`, for parts that are small.
    """

    counts = True

    def __init__(self) -> None:
        self.changed: Signal[[Any]] = Signal()

    def clear(self) -> None:
        """Be as in a run that was never looked at."""
        raise NotImplementedError

    def to_json(self) -> Any:
        """The whole state as JSON values."""
        raise NotImplementedError

    def from_json(self, data: Any, source: str) -> None:
        """Take the state that `to_json` wrote.

        Raises
        ------
        RunError
            When the data is no such state; the sentence names `source`.
        """
        raise NotImplementedError

    def replay(self, record: Any, source: str) -> None:
        """Make a change again that the journal tells of. Errors as `from_json`."""
        self.from_json(record, source)

    def store(self, folder: Path) -> None:
        """Write what is too large for the session file into the run folder, before that file is written. Nothing by default."""

    def load(self, folder: Path) -> None:
        """Read what `store` wrote, before `from_json`. Nothing by default."""
