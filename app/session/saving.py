"""What a session is saved as: taken at one instant, and written in any thread while the session goes on."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from degense.app.session import session_file
from degense.app.session.journal import Entry
from degense.app.session.session_file import SavedSession
from degense.app.session.state import Storing
from degense.engine.files import write_text


@dataclass(frozen=True, eq=False)
class Saving:
    """One save: what the folder will hold when it is written."""

    folder: Path
    saved: SavedSession
    stored: Sequence[Storing]  # what lies beside the session file
    missed: Sequence[Entry]  # changes up to now that no journal took: they are lost when neither this is written
    moved_from: Path | None = None  # where it is noted that the folder is another than its own

    def write(self) -> None:
        """Write all of it. DegenseError when the folder cannot be written; what was there before still opens."""
        for storing in self.stored:
            storing.write()
        session_file.write(self.folder / session_file.NAME, self.saved)
        if self.moved_from is not None:
            write_text(self.moved_from, str(self.folder))


def plain(state: Any) -> Any:
    """A state as it comes back from a file: tuples are lists."""
    return json.loads(json.dumps(state))
