"""What a session is saved as, and what it is opened with: written and read in any thread, while what is open goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from degense.app.session import session_file, state_folder
from degense.app.session.folder_locks import FolderHeld, FolderLocks
from degense.app.session.journal import Entry
from degense.app.session.session_file import DamagedSession, SavedSession
from degense.app.session.state import PersistentState, Storing
from degense.engine.errors import DegenseError, RunError
from degense.engine.files import write_text

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene


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


@dataclass(eq=False)
class Reading:
    """What is saved of a run or clip, and the locks of whoever changes it, which are let go when this is forgotten."""

    own: Path  # the folder where it belongs
    source: Path  # the run or clip
    keep: bool  # whether it is written, and journaled; not for the sample
    locks: FolderLocks
    again: bool  # whether it is what is open, whose locks these are
    changes: int  # how often what is open had been changed when this was begun
    elsewhere: bool = False  # whether another window holds it
    problem: str = ""  # why it cannot be written, in one sentence
    saved: SavedSession = field(default_factory=SavedSession)
    unsaved: tuple[Entry, ...] = ()  # what a crash left in the journal
    take: tuple[Callable[[], None], ...] = ()  # makes what was read the states, in their thread
    damage: DamagedSession | None = None  # why it cannot be opened

    def __post_init__(self) -> None:
        self.home, self.folder = state_folder.folder_of(self.own), state_folder.saved_in(self.own)

    @property
    def path(self) -> Path:
        """The session file."""
        return self.folder / session_file.NAME

    def read(self, states: Mapping[str, PersistentState], scene: Scene | None, clip: Clip | None) -> None:
        """Take the locks, then read. RunError when the run is gone, DegenseError when the journal cannot be read."""
        if self.keep:
            self._hold()
        try:
            self.saved = session_file.read(self.path)
            self.take = tuple(state.read(self.folder, scene, clip) for state in states.values())
        except DamagedSession as error:
            self.damage = error
        except DegenseError as error:
            self.damage = DamagedSession(self.path, str(error))
        if scene is not None and not self.folder.is_dir():  # its session would seem to be a new one
            raise RunError(f"{self.source} is not there any more; open it again when its drive is.")
        if not self.again:  # else it is being written
            self.read_journal(states)

    def read_journal(self, states: Mapping[str, PersistentState]) -> None:
        """Read what a crash left, where nobody else writes the journal. DegenseError when it cannot be read."""
        if self.damage is None and self.home in self.locks and not self.elsewhere:
            left = state_folder.left_in_journal(self.home, self.folder, self.saved.id)
            self.unsaved = tuple(entry for entry in left if entry.state in states)

    def _hold(self) -> None:
        try:
            self.locks.hold(self.home, self.source.name, with_parents=True)
            if self.folder.is_dir():
                self.locks.hold(self.folder, self.source.name)
        except DegenseError as error:
            self.problem, self.elsewhere = str(error), isinstance(error, FolderHeld)


def plain(state: Any) -> Any:
    """A state as it comes back from a file: tuples are lists."""
    return json.loads(json.dumps(state))
