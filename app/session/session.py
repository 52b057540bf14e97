"""The session: what is open, what is shown, and at which instant. No Qt; windows, tests and scripts drive the same object."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from degense.app.features.annotate.state import AnnotationsPart
from degense.app.session import session_file
from degense.app.session.persistent_state import Part
from degense.app.session.signal import Signal
from degense.app.session.state import CameraMode, PersistentViewState, Place
from degense.app.session.store import SessionStore
from degense.app.session.targets import Target
from degense.app.session.undo import UndoStack
from degense.app.session.view_state import Colour, ColourRange, Compare, Prompt, ViewState, decoder_refined
from degense.engine.errors import DegenseError, PromptError

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene


class Session:
    """State of one window.

    Either a scene is open (`scene`, and `clip` when the clip it was made from is still there), or a clip alone, or nothing.

    Signals
    -------
    opened()
        Another scene or clip, or none.
    frame_changed(frame), playing_changed(playing), camera_mode_changed(mode), probe_changed(target or None), dirty_changed(dirty)
    look_changed(before, after)
        Two `ViewState` values, for views that redraw only what changed.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.opened: Signal[[]] = Signal()
        self.frame_changed: Signal[[int]] = Signal()
        self.playing_changed: Signal[[bool]] = Signal()
        self.view_state_changed: Signal[[ViewState, ViewState]] = Signal()
        self.camera_mode_changed: Signal[[str]] = Signal()
        self.probe_changed: Signal[[Target | None]] = Signal()
        self.scene: Scene | None = None
        self.clip: Clip | None = None
        self.undo = UndoStack(clock=clock)
        self.store = SessionStore()
        self.dirty_changed = self.store.dirty_changed
        self._view, self._place = PersistentViewState(), Place()
        self._playing = False
        self.register(session_file.LOOK, self._view)
        self.register("place", self._place)
        self.annotations = AnnotationsPart(self)
        self.register("annotations", self.annotations)

    # What is open

    def register(self, name: str, part: Part) -> None:
        """Hold a part and save it under this name with each run.

        Raises
        ------
        ValueError
            When the name is taken.
        """
        self.store.register(name, part)

    def open_scene(self, scene: Scene, keep: bool = True) -> None:
        """Show a run, with the session saved in its folder. `store.unsaved` tells whether a crash left work there: see `recover`.

        Parameters
        ----------
        keep : bool
            Whether to save and to keep a journal; not for the sample.

        Raises
        ------
        DamagedSession
            When the session file is damaged. Nothing is open then.
        """
        self.close()
        self.scene, self.clip = scene, scene.clip
        try:
            self.store.open(scene.run.path, keep)
            self._place.frame = min(self._place.frame, max(0, self.frames - 1))
        except DegenseError:
            self.scene = self.clip = None
            raise
        finally:
            self.opened.emit()
        if self._place.frame:
            self.frame_changed.emit(self._place.frame)
        if self._place.camera_mode != "surgeon":
            self.camera_mode_changed.emit(self._place.camera_mode)
        if self._place.probe is not None:
            self.probe_changed.emit(self._place.probe)

    def recover(self) -> None:
        """Bring back what a crash left unsaved.

        Raises
        ------
        RunError
            When a part of it is damaged; what came before is back.
        """
        before = self._view.view_state
        try:
            self.store.recover()
        finally:
            self.view_state_changed.emit(before, self._view.view_state)

    def open_clip(self, clip: Clip) -> None:
        """Show a clip that has no run yet, annotated as it was left, also by a crash.

        Raises
        ------
        DegenseError
            When what a crash left cannot be used; all else is open.
        """
        self.close()
        self.clip = clip
        self.annotations.load_beside_clip()
        self.opened.emit()
        self.annotations.recover_beside_clip()

    def close(self) -> None:
        """Forget everything. Emits nothing about it: `open_scene` and `open_clip` do."""
        self.pause()
        self.scene = self.clip = None
        self.store.close()
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
        return self._place.frame

    def go_to(self, frame: int) -> None:
        """Show a frame; numbers outside the clip are clamped."""
        frame = min(max(0, int(frame)), max(0, self.frames - 1))
        if frame != self._place.frame:
            self._place.frame = frame
            self.frame_changed.emit(frame)

    def step(self, frames: int) -> None:
        """Stop and go some frames on (or back)."""
        self.pause()
        self.go_to(self._place.frame + frames)

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
    def view_state(self) -> ViewState:
        return self._view.view_state

    def edit(self, name: str, view_state: ViewState, key: str | None = None) -> None:
        """Show another look, as an undoable step called `name`. Edits with the same `key` in quick succession become one step."""
        if view_state != self._view.view_state:
            before = self._view.view_state
            self._set_view_state(view_state)
            self.undo.push(name, self._set_view_state, before, view_state, key)

    def set_layer(self, layer: str) -> None:
        self.edit(f"Show {layer}", replace(self._view.view_state, layer=layer))

    def set_decoder(self, decoder: str) -> None:
        self.edit(f"Decode masks with {decoder}", replace(self._view.view_state, decoder=decoder))

    def set_overlay_opacity(self, opacity: float) -> None:
        self.edit("Mask opacity", replace(self._view.view_state, overlay_opacity=min(1.0, max(0.0, opacity))), key="opacity")

    def set_compare(self, compare: Compare) -> None:
        self.edit(f"Compare: {compare}", replace(self._view.view_state, compare=compare))

    def set_range(self, layer: str, colour_range: ColourRange) -> None:
        self.edit(f"Colour range of {layer}", self._view.view_state.with_range(layer, colour_range), key=f"range-{layer}")

    def set_threshold(self, threshold: float) -> None:
        self.edit("Mask threshold", replace(self._view.view_state, threshold=threshold), key="threshold")

    def set_masks_shown(self, shown: bool) -> None:
        self.edit("Show masks" if shown else "Hide masks", replace(self._view.view_state, masks_shown=shown))

    def add_prompt(self, text: str, colour: Colour | None = None, negative: bool = False) -> Prompt:
        """Show the mask of a text, in the next free colour when none is given; a negative takes pixels from the masks of the others.

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
        if any(prompt.text.casefold() == text.casefold() for prompt in self._view.view_state.prompts):
            raise PromptError(f"“{text}” is already in the list.")
        self.scene.meanings(text)
        prompt = Prompt(text, colour or self._view.view_state.next_colour(), negative=negative)
        self.edit(f"Prompt {text}", replace(self._view.view_state, prompts=(*self._view.view_state.prompts, prompt)))
        return prompt

    def remove_prompt(self, text: str) -> None:
        gone = self._view.view_state.prompt(text)
        self.edit(
            f"Remove {gone.text}", replace(self._view.view_state, prompts=tuple(p for p in self._view.view_state.prompts if p is not gone))
        )

    def set_negative(self, text: str, negative: bool) -> None:
        """Let a prompt take pixels from the masks of the others, or have a mask of its own."""
        prompt = self._view.view_state.prompt(text)
        self._change_prompt(f"{prompt.text}: {'negative' if negative else 'positive'}", replace(prompt, negative=negative))

    def set_refined(self, refined: bool) -> None:
        """Decide masks region by region along the edges of the picture, or pixel by pixel."""
        self.set_decoder(decoder_refined(self._view.view_state.decoder, refined))

    def set_visible(self, text: str, visible: bool) -> None:
        prompt = self._view.view_state.prompt(text)
        self._change_prompt(f"{'Show' if visible else 'Hide'} {prompt.text}", replace(prompt, visible=visible))

    def set_colour(self, text: str, colour: Colour) -> None:
        prompt = self._view.view_state.prompt(text)
        self._change_prompt(f"Colour of {prompt.text}", replace(prompt, colour=colour))

    def _change_prompt(self, name: str, prompt: Prompt) -> None:
        self.edit(
            name,
            replace(self._view.view_state, prompts=tuple(prompt if p.text == prompt.text else p for p in self._view.view_state.prompts)),
        )

    def _set_view_state(self, view_state: ViewState) -> None:
        before, self._view.view_state = self._view.view_state, view_state
        self._view.changed.emit(None)
        self.view_state_changed.emit(before, view_state)

    # Camera and probe

    @property
    def camera_mode(self) -> CameraMode:
        """`surgeon`: both views through the clip's camera. `free`: the 3D view goes where the user turns it."""
        return self._place.camera_mode

    @camera_mode.setter
    def camera_mode(self, mode: CameraMode) -> None:
        if mode != self._place.camera_mode:
            self._place.camera_mode = mode
            self.camera_mode_changed.emit(mode)

    @property
    def probe(self) -> Target | None:
        """The spot, region or mask whose curves are shown."""
        return self._place.probe

    @probe.setter
    def probe(self, target: Target | None) -> None:
        self._place.probe = target
        self.probe_changed.emit(target)

    # Saving

    @property
    def dirty(self) -> bool:
        """Whether there is work that the run folder does not hold."""
        return self.store.dirty

    def save(self) -> None:
        """Write everything into the run folder, where `open_scene` finds it. Errors as `SessionStore.save`."""
        self.store.save()
