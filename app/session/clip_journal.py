"""What was done to the annotations of a clip since they were saved beside it; a run has its session's journal for that."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from degense.app.session import journal, session_file
from degense.app.session.journal import Journal
from degense.app.session.signal import Signal
from degense.engine.annotation.folder import INDEX
from degense.engine.errors import DegenseError

NAME, PART = "annotations.journal", "annotations"


class ClipJournal:
    """Records beside the saved annotations that they go on from. Nothing is written before the first is told.

    Parameters
    ----------
    folder : Path
        Where the annotations are saved.
    trouble : Signal
        Told once, in a sentence, when the journal cannot be written, until it can be again.
    """

    def __init__(self, folder: Path, trouble: Signal[[str]]) -> None:
        self.path = folder / NAME
        self._trouble, self._troubled = trouble, False
        self._journal: Journal | None = None

    def left(self) -> Iterator[Any]:
        """What a crash left here. A journal of other annotations (saved since, or put back from a backup) is set aside."""
        if not journal.continues(self.path, self._saved()):
            session_file.set_aside(self.path)
        yield from (entry.record for entry in journal.entries(self.path, self._saved()))

    def tell(self, record: Any) -> None:
        """Add a record."""
        try:
            if self._journal is None:
                self.path.parent.mkdir(exist_ok=True)
                self._journal = Journal(self.path, self._saved())
            self._journal.tell(PART, record)
            self._troubled = False
        except (OSError, DegenseError) as error:
            if not self._troubled:
                self._troubled = True
                self._trouble.emit(f"What is painted cannot be kept as it is painted: {error}")

    def forget(self) -> None:
        """Everything is saved."""
        self.close()
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def _saved(self) -> str:
        """Which annotations are saved: the check sum of their index, which names the pictures by theirs; empty for none."""
        index = self.path.with_name(INDEX)
        return f"{zlib.crc32(index.read_bytes()):08x}" if index.is_file() else ""
