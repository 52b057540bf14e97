"""The session: what is open, what is shown, and at which instant. No Qt; windows, tests and scripts drive the same object."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from app import session_file
from app.look import Colour, ColourRange, Compare, Look, Prompt
from app.part import Part
from app.signal import Signal
from app.undo import UndoStack
from engine.errors import PromptError

if TYPE_CHECKING:
    from engine.clip import Clip
    from engine.scene import Scene

CameraMode = Literal["surgeon", "free"]


class Session:
    """State of one window.

    Either a scene is open (`scene`, and `clip` when the clip it was made from is still there), or a clip alone, or nothing.

    Signals
    -------
    opened()
        Another scene or clip, or none.
    frame_changed(frame), playing_changed(playing), camera_mode_changed(mode), probe_changed(pixel or None), dirty_changed(dirty)
    look_changed(before, after)
        Two `Look` values, for views that redraw only what changed.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.opened: Signal[[]] = Signal()
        self.frame_changed: Signal[[int]] = Signal()
        self.playing_changed: Signal[[bool]] = Signal()
        self.look_changed: Signal[[Look, Look]] = Signal()
        self.camera_mode_changed: Signal[[str]] = Signal()
        self.probe_changed: Signal[[tuple[float, float] | None]] = Signal()
        self.dirty_changed: Signal[[bool]] = Signal()
        self.scene: Scene | None = None
        self.clip: Clip | None = None
        self.undo = UndoStack(clock=clock)
        self.parts: dict[str, Part] = {}
        self._look = self._saved = Look()
        self._frame = 0
        self._playing = False
        self._camera_mode: CameraMode = "surgeon"
        self._probe: tuple[float, float] | None = None
        self._kept: dict[str, Any] = {}
        self._parts_dirty = False

    # What is open

    def register(self, name: str, part: Part) -> None:
        """Hold a part and save it under this name with each run.

        Raises
        ------
        ValueError
            When the name is taken.
        """
        if name in self.parts or name == session_file.LOOK:
            raise ValueError(f"the session already has a part called {name!r}")
        self.parts[name] = part
        part.changed.connect(lambda record: self._part_changed(part))

    def open_scene(self, scene: Scene) -> None:
        """Show a run, from the reference frame, with the session saved in its folder.

        Raises
        ------
        RunError
            When the session file is damaged; the run is open then, with a fresh view.
        """
        self.close()
        self.scene, self.clip = scene, scene.clip
        try:
            self._load(scene.run.path)
        finally:
            self._mark_saved()
            self.opened.emit()

    def _load(self, folder: Path) -> None:
        source = folder / session_file.NAME
        self._kept = session_file.read(source)
        if session_file.LOOK in self._kept:
            self._look = Look.from_json(self._kept[session_file.LOOK], str(source))
        for name, part in self.parts.items():
            part.load(folder)
            if name in self._kept:
                part.from_json(self._kept[name], str(source))

    def open_clip(self, clip: Clip) -> None:
        """Show a clip that has no run yet."""
        self.close()
        self.clip = clip
        self.opened.emit()

    def close(self) -> None:
        """Forget everything. Emits nothing about it: `open_scene` and `open_clip` do."""
        self.pause()
        self.scene = self.clip = None
        self._look = self._saved = Look()
        self._frame, self._probe, self._camera_mode = 0, None, "surgeon"
        self._kept = {}
        for part in self.parts.values():
            part.clear()
        self._parts_dirty = False
        self.undo.clear()

    @property
    def name(self) -> str:
        source = self.scene or self.clip
        return source.name if source else ""

    @property
    def frames(self) -> int:
        return self.scene.frames if self.scene else len(self.clip) if self.clip else 0

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the surgeon's picture; (0, 0) when nothing is open."""
        return self.scene.clip_size if self.scene else self.clip.size if self.clip else (0, 0)

    # The instant

    @property
    def frame(self) -> int:
        return self._frame

    def go_to(self, frame: int) -> None:
        """Show a frame; numbers outside the clip are clamped."""
        frame = min(max(0, int(frame)), max(0, self.frames - 1))
        if frame != self._frame:
            self._frame = frame
            self.frame_changed.emit(frame)

    def step(self, frames: int) -> None:
        """Stop and go some frames on (or back)."""
        self.pause()
        self.go_to(self._frame + frames)

    @property
    def playing(self) -> bool:
        """Whether time runs. The window's timeline is the clock; it asks for the frames through `go_to`."""
        return self._playing

    def play(self) -> None:
        if self.frames > 1 and not self._playing:
            self._playing = True
            self.playing_changed.emit(True)

    def pause(self) -> None:
        if self._playing:
            self._playing = False
            self.playing_changed.emit(False)

    def toggle_playing(self) -> None:
        self.pause() if self._playing else self.play()

    # The look

    @property
    def look(self) -> Look:
        return self._look

    def edit(self, name: str, look: Look, key: str | None = None) -> None:
        """Show another look, as an undoable step called `name`. Edits with the same `key` in quick succession become one step."""
        if look != self._look:
            before = self._look
            self._set_look(look)
            self.undo.push(name, self._set_look, before, look, key)

    def set_layer(self, layer: str) -> None:
        self.edit(f"Show {layer}", replace(self._look, layer=layer))

    def set_decoder(self, decoder: str) -> None:
        self.edit(f"Decode masks with {decoder}", replace(self._look, decoder=decoder))

    def set_overlay_opacity(self, opacity: float) -> None:
        self.edit("Mask opacity", replace(self._look, overlay_opacity=min(1.0, max(0.0, opacity))), key="opacity")

    def set_compare(self, compare: Compare) -> None:
        self.edit(f"Compare: {compare}", replace(self._look, compare=compare))

    def set_range(self, layer: str, colour_range: ColourRange) -> None:
        self.edit(f"Colour range of {layer}", self._look.with_range(layer, colour_range), key=f"range-{layer}")

    def set_threshold(self, threshold: float) -> None:
        self.edit("Mask threshold", replace(self._look, threshold=threshold), key="threshold")

    def set_masks_shown(self, shown: bool) -> None:
        self.edit("Show masks" if shown else "Hide masks", replace(self._look, masks_shown=shown))

    def add_prompt(self, text: str, colour: Colour | None = None) -> Prompt:
        """Show the mask of a text, in the next free colour when none is given.

        Raises
        ------
        PromptError
            When no scene is open, the text is empty or already prompted, or the scene's encoder does not know its words.
        DegenseError
            When the scene was trained without semantics.
        """
        text = " ".join(text.split())
        if self.scene is None:
            raise PromptError("Open a run first: prompts are answered by a reconstructed scene.")
        if not text:
            raise PromptError("Type what to look for, such as gallbladder.")
        if any(prompt.text.casefold() == text.casefold() for prompt in self._look.prompts):
            raise PromptError(f"“{text}” is already in the list.")
        self.scene.meanings(text)
        prompt = Prompt(text, colour or self._look.next_colour())
        self.edit(f"Prompt {text}", replace(self._look, prompts=(*self._look.prompts, prompt)))
        return prompt

    def remove_prompt(self, text: str) -> None:
        gone = self._look.prompt(text)
        self.edit(f"Remove {gone.text}", replace(self._look, prompts=tuple(p for p in self._look.prompts if p is not gone)))

    def set_visible(self, text: str, visible: bool) -> None:
        prompt = self._look.prompt(text)
        self._change_prompt(f"{'Show' if visible else 'Hide'} {prompt.text}", replace(prompt, visible=visible))

    def set_colour(self, text: str, colour: Colour) -> None:
        prompt = self._look.prompt(text)
        self._change_prompt(f"Colour of {prompt.text}", replace(prompt, colour=colour))

    def _change_prompt(self, name: str, prompt: Prompt) -> None:
        self.edit(name, replace(self._look, prompts=tuple(prompt if p.text == prompt.text else p for p in self._look.prompts)))

    def _set_look(self, look: Look) -> None:
        before, was_dirty = self._look, self.dirty
        self._look = look
        self.look_changed.emit(before, look)
        if self.dirty != was_dirty:
            self.dirty_changed.emit(self.dirty)

    # Camera and probe

    @property
    def camera_mode(self) -> CameraMode:
        """`surgeon`: both views through the clip's camera. `free`: the 3D view goes where the user turns it."""
        return self._camera_mode

    @camera_mode.setter
    def camera_mode(self, mode: CameraMode) -> None:
        if mode != self._camera_mode:
            self._camera_mode = mode
            self.camera_mode_changed.emit(mode)

    @property
    def probe(self) -> tuple[float, float] | None:
        """The clicked pixel (x, y) of the surgeon's picture whose curves are shown."""
        return self._probe

    @probe.setter
    def probe(self, pixel: tuple[float, float] | None) -> None:
        self._probe = pixel
        self.probe_changed.emit(pixel)

    # Saving

    @property
    def dirty(self) -> bool:
        """Whether there is work that the run folder does not hold."""
        return self._look != self._saved or self._parts_dirty

    def save(self) -> None:
        """Write everything into the run folder, where `open_scene` finds it. Parts of the file that nobody registered stay in it.

        Raises
        ------
        DegenseError
            When the folder cannot be written; what was there before stays, and so does `dirty`.
        """
        if self.scene is None:
            return
        folder, was_dirty = self.scene.run.path, self.dirty
        for part in self.parts.values():
            part.store(folder)
        parts = {name: part.to_json() for name, part in self.parts.items()}
        self._kept = {**self._kept, session_file.LOOK: self._look.to_json(), **parts}
        session_file.write(folder / session_file.NAME, self._kept)
        self._mark_saved()
        if was_dirty:
            self.dirty_changed.emit(False)

    def _mark_saved(self) -> None:
        self._saved, self._parts_dirty = self._look, False

    def _part_changed(self, part: Part) -> None:
        was_dirty = self.dirty
        self._parts_dirty |= part.counts and self.scene is not None
        if self.dirty != was_dirty:
            self.dirty_changed.emit(True)
