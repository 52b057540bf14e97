"""The session: what is open, what is shown, and at which instant. No Qt; windows, tests and scripts drive the same object."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from degense.app.session import session_file
from degense.app.session.cursor import CameraMode, Cursor
from degense.app.session.saving import Reading
from degense.app.session.state import PersistentState, Signal
from degense.app.session.store import SessionStore
from degense.app.session.targets import Target
from degense.app.session.undo import UndoStack
from degense.app.session.view_editor import ViewEditor
from degense.app.session.view_state import ViewState
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene

#: (scene, clip, keep)
Reader = Callable[["Scene | None", "Clip | None", bool], Reading]


class Session:
    """State of one window.

    Either a scene is open (`scene`, and `clip` when the clip it was made from is still there), or a clip alone, or nothing.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.opened: Signal[[]] = Signal()  # another scene or clip, or none
        self.frame_changed: Signal[[int]] = Signal()  # (frame)
        self.playing_changed: Signal[[bool]] = Signal()  # (playing)
        self.camera_mode_changed: Signal[[str]] = Signal()  # (mode)
        self.probe_changed: Signal[[Target | None]] = Signal()  # (target or None)
        self.scene: Scene | None = None
        self.clip: Clip | None = None
        self.undo = UndoStack(clock=clock)
        self.store = SessionStore()
        self.dirty_changed = self.store.dirty_changed  # (dirty)
        self.view, self._cursor = ViewEditor(self.undo, lambda: self.scene), Cursor()
        self.view_state_changed = self.view.view_changed  # (before, after) of `view`
        self.playing = False  # the window's timeline is the clock; it asks for the frames through `go_to`
        self.register(session_file.VIEW, self.view)
        self.register("place", self._cursor)

    # What is open

    def register(self, name: str, state: PersistentState) -> None:
        """Save a state under this name with each run and clip. ValueError when the name is taken."""
        self.store.register(name, state)

    def open_scene(self, scene: Scene, keep: bool = True) -> None:
        """Show a run, with the session saved in its folder. `store.unsaved` tells whether a crash left work there: see `recover`.

        `keep` says whether to save and to write a journal; not for the sample.
        DamagedSession when the session file is damaged. Nothing is open then.
        """
        self._open(scene, scene.clip, keep)

    def open_clip(self, clip: Clip, keep: bool = True) -> None:
        """Show a clip that has no run yet, with the session saved beside it (`session_file.clip_folder`); otherwise as `open_scene`."""
        self._open(None, clip, keep)

    def _open(self, scene: Scene | None, clip: Clip | None, keep: bool) -> None:
        self.close()
        self.open(scene, clip, self.reader()(scene, clip, keep))

    def reader(self) -> Reader:
        """Reads, in any thread and while something is open, what `open` needs of a run or clip; the last argument is `keep`.

        DegenseError when the journal cannot be read.
        """
        self.store.write_pending()
        changes = self.store.changes

        def read(scene: Scene | None, clip: Clip | None, keep: bool) -> Reading:
            if scene is not None:
                own = source = scene.run.path
            else:
                assert clip is not None
                own, source = session_file.clip_folder(clip.path), clip.path
            reading = self.store.reading(own, source, keep, changes)
            reading.read(self.store.states, scene, clip)
            return reading

        return read

    def open(self, scene: Scene | None, clip: Clip | None, reading: Reading) -> None:
        """Show a run or clip in place of what is open. Errors as `open_scene`."""
        self.pause()
        self.undo.clear()
        self.scene, self.clip = scene, clip
        try:
            self.store.open(reading)
            self._cursor.frame = min(self._cursor.frame, max(0, self.frames - 1))
        except DegenseError:
            self.scene = self.clip = None
            raise
        finally:
            self.opened.emit()
        if self._cursor.frame:
            self.frame_changed.emit(self._cursor.frame)
        if self._cursor.camera_mode != "surgeon":
            self.camera_mode_changed.emit(self._cursor.camera_mode)
        if self._cursor.probe is not None:
            self.probe_changed.emit(self._cursor.probe)

    def recover(self) -> None:
        """Bring back what a crash left unsaved. Errors as `SessionStore.recover`."""
        before = self.view_state
        try:
            self.store.recover()
        finally:
            self.view_state_changed.emit(before, self.view_state)

    def close(self) -> None:
        """Close what is open. `opened` is emitted when something is opened only."""
        self.pause()
        self.scene = self.clip = None
        self.store.close()
        self.undo.clear()

    @property
    def name(self) -> str:
        source = self.scene or self.clip
        return source.name if source else ""

    def has_scene(self) -> bool:
        return self.scene is not None

    @property
    def frames(self) -> int:
        return self.scene.frames if self.scene else len(self.clip) if self.clip else 0

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the surgeon's frame; (0, 0) when nothing is open."""
        return self.scene.clip_size if self.scene else self.clip.size if self.clip else (0, 0)

    # The frame

    @property
    def frame(self) -> int:
        return self._cursor.frame

    def go_to(self, frame: int) -> None:
        """Show a frame; numbers outside the clip are clamped."""
        frame = min(max(0, int(frame)), max(0, self.frames - 1))
        if frame != self._cursor.frame:
            self._cursor.frame = frame
            self.frame_changed.emit(frame)

    def step(self, frames: int) -> None:
        """Stop and go some frames on (or back)."""
        self.pause()
        self.go_to(self._cursor.frame + frames)

    def play(self) -> None:
        if self.frames > 1 and not self.playing:
            self.playing = True
            self.playing_changed.emit(True)

    def pause(self) -> None:
        if self.playing:
            self.playing = False
            self.playing_changed.emit(False)

    def toggle_playing(self) -> None:
        self.pause() if self.playing else self.play()

    @property
    def view_state(self) -> ViewState:
        """What is shown and how; `view` changes it."""
        return self.view.state

    # Camera and probe

    @property
    def camera_mode(self) -> CameraMode:
        """`surgeon`: both views through the clip's camera. `free`: the 3D view goes where the user turns it."""
        return self._cursor.camera_mode

    @camera_mode.setter
    def camera_mode(self, mode: CameraMode) -> None:
        if mode != self._cursor.camera_mode:
            self._cursor.camera_mode = mode
            self.camera_mode_changed.emit(mode)

    @property
    def probe(self) -> Target | None:
        """The spot, region or mask whose curves are shown."""
        return self._cursor.probe

    @probe.setter
    def probe(self, target: Target | None) -> None:
        self._cursor.probe = target
        self.probe_changed.emit(target)

    # Saving

    @property
    def dirty(self) -> bool:
        """Whether there is work that is not saved."""
        return self.store.dirty

    def save(self) -> None:
        """Write everything to where it is opened from. Errors as `SessionStore.save`."""
        self.store.save()
