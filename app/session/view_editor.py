"""Edits of the view state: each is one undoable step, but for what only switches the view. No Qt."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from degense.app.session.state import PersistentState, Signal
from degense.app.session.undo import UndoStack
from degense.app.session.view_state import Colour, ColourRange, Compare, Prompt, ViewState, decoder_refined
from degense.engine.errors import PromptError

if TYPE_CHECKING:
    from degense.engine.scene import Scene


class ViewEditor(PersistentState):
    """Holds and edits the session's view state, `state`. The encoder of the open `scene` must know the words of prompts.

    Which layers and masks are drawn, how opaque, and beside what, is a switch of the view and no undo step; undoing leaves it as it is.
    """

    def __init__(self, undo: UndoStack, scene: Callable[[], Scene | None]) -> None:
        super().__init__()
        self._undo, self._scene = undo, scene
        #: (before, after) the `ViewState` before and after, for views that redraw only what changed.
        self.view_changed: Signal[[ViewState, ViewState]] = Signal()
        self.state = ViewState()

    def clear(self) -> None:
        self.state = ViewState()

    def to_json(self) -> Any:
        return self.state.to_json()

    def from_json(self, data: Any, source: str) -> None:
        self.state = ViewState.from_json(data, source)

    def edit(self, name: str, state: ViewState, key: str | None = None) -> None:
        """Show something else, as an undoable step called `name`. Edits with the same `key` in quick succession become one step."""
        self._undo.do(name, self._put, self.state, state, key)

    def set_layer(self, layer: str) -> None:
        """Show one layer alone."""
        alone = tuple(replace(blend, visible=False) for blend in self.state.blend)
        self._set(replace(self.state, layer=layer, blend=alone))

    def choose_layer(self, layer: str) -> None:
        """Choose one of the layers that are drawn, beside the others; one that is not drawn is shown alone."""
        if all(blend.name != layer for blend in self.state.drawn):
            self.set_layer(layer)
        elif layer != self.state.layer:
            self._set(replace(self._with_blend(self.state.layer, visible=True), layer=layer))

    def set_layer_visible(self, layer: str, visible: bool) -> None:
        """Draw a layer besides the others, and choose it, or no longer; the last one that is drawn stays."""
        if visible:
            self._set(replace(self._with_blend(self.state.layer, visible=True), layer=layer))
            return
        others = [blend.name for blend in self.state.drawn if blend.name != layer]
        if others:
            self._set(replace(self._with_blend(layer, visible=False), layer=others[-1] if layer == self.state.layer else self.state.layer))

    def set_layer_opacity(self, layer: str, opacity: float) -> None:
        self._set(self._with_blend(layer, opacity=min(1.0, max(0.0, opacity))))

    def move_layer(self, layer: str, place: int) -> None:
        """Put a layer at a place of the order, 0 the lowest."""
        [moved] = [blend for blend in self.state.blend if blend.name == layer]
        blend = [blend for blend in self.state.blend if blend is not moved]
        blend.insert(place, moved)
        self._set(replace(self.state, blend=tuple(blend)))

    def _with_blend(self, layer: str, **changes: bool | float) -> ViewState:
        blend = tuple(replace(blend, **changes) if blend.name == layer else blend for blend in self.state.blend)  # type: ignore[arg-type]
        return replace(self.state, blend=blend)

    def set_decoder(self, decoder: str) -> None:
        self.edit(f"Decode masks with {decoder}", replace(self.state, decoder=decoder))

    def set_overlay_opacity(self, opacity: float) -> None:
        self._set(replace(self.state, overlay_opacity=min(1.0, max(0.0, opacity))))

    def set_compare(self, compare: Compare) -> None:
        self._set(replace(self.state, compare=compare))

    def set_range(self, layer: str, colour_range: ColourRange) -> None:
        self.edit(f"Colour range of {layer}", self.state.with_range(layer, colour_range), key=f"range-{layer}")

    def set_threshold(self, threshold: float) -> None:
        self.edit("Mask threshold", replace(self.state, threshold=threshold), key="threshold")

    def set_masks_shown(self, shown: bool) -> None:
        self._set(replace(self.state, masks_shown=shown))

    def add_prompt(self, text: str, colour: Colour | None = None, negative: bool = False) -> Prompt:
        """Show the mask of a text, in the next free colour when none is given; a negative takes pixels from the masks of the others.

        Raises
        ------
        PromptError
            When no scene is open, the text is empty or already prompted, or the scene's encoder does not know its words.
        DegenseError
            When the scene was trained without semantics.
        """
        text = self._asked(text, self.state.prompts)
        prompt = Prompt(text, colour or self.state.next_colour(), negative=negative)
        self.edit(f"Prompt {text}", replace(self.state, prompts=(*self.state.prompts, prompt)))
        return prompt

    def rename_prompt(self, text: str, words: str, negative: bool) -> None:
        """Ask for something else in the place of a prompt, in its colour. Raises as `add_prompt`."""
        before = self.state.prompt(text)
        words = self._asked(words, [prompt for prompt in self.state.prompts if prompt is not before])
        prompts = tuple(replace(p, text=words, negative=negative) if p is before else p for p in self.state.prompts)
        self.edit(f"Prompt {words} in place of {before.text}", replace(self.state, prompts=prompts))

    def _asked(self, text: str, others: Iterable[Prompt]) -> str:
        """The words of a prompt, with single spaces, when the open scene knows them and none of `others` has them."""
        text, scene = " ".join(text.split()), self._scene()
        if scene is None:
            raise PromptError("Open a run first: prompts are answered by a reconstructed scene.")
        if not text:
            raise PromptError("Type what to look for, such as gallbladder.")
        if any(prompt.text.casefold() == text.casefold() for prompt in others):
            raise PromptError(f"“{text}” is already in the list.")
        scene.question(text)
        return text

    def add_example(self, frame: int, x: int, y: int) -> Prompt:
        """Let the last visible prompt also find what looks like a pixel of a frame, or make it a prompt when there is none."""
        from degense.engine.semantics.examples import Example

        place = str(Example(frame, x, y))
        if not self.state.visible_prompts:
            return self.add_prompt(place)
        last = self.state.visible_prompts[-1]
        scene = self._scene()
        assert scene is not None
        scene.question(f"{last.text} {place}")
        prompts = tuple(replace(p, text=f"{p.text} {place}") if p is last else p for p in self.state.prompts)
        self.edit(f"Example for {last.text}", replace(self.state, prompts=prompts))
        return self.state.prompt(f"{last.text} {place}")

    def remove_prompt(self, text: str) -> None:
        gone = self.state.prompt(text)
        self.edit(f"Remove {gone.text}", replace(self.state, prompts=tuple(p for p in self.state.prompts if p is not gone)))

    def set_negative(self, text: str, negative: bool) -> None:
        """Let a prompt take pixels from the masks of the others, or have a mask of its own."""
        prompt = self.state.prompt(text)
        self._change_prompt(f"{prompt.text}: {'negative' if negative else 'positive'}", replace(prompt, negative=negative))

    def set_refined(self, refined: bool) -> None:
        """Decide masks region by region along the edges of the frame, or pixel by pixel."""
        self.set_decoder(decoder_refined(self.state.decoder, refined))

    def set_visible(self, text: str, visible: bool) -> None:
        shown = self.state.prompt(text)
        self._set(replace(self.state, prompts=tuple(replace(p, visible=visible) if p is shown else p for p in self.state.prompts)))

    def set_colour(self, text: str, colour: Colour) -> None:
        prompt = self.state.prompt(text)
        self._change_prompt(f"Colour of {prompt.text}", replace(prompt, colour=colour))

    def _change_prompt(self, name: str, prompt: Prompt) -> None:
        prompts = tuple(prompt if p.text == prompt.text else p for p in self.state.prompts)
        self.edit(name, replace(self.state, prompts=prompts))

    def _put(self, state: ViewState) -> None:
        """A step of the history, viewed as things are now: layers, masks, and the eyes of the prompts that there are before and after."""
        now, eyes = self.state, {prompt.text: prompt.visible for prompt in self.state.prompts}
        self._set(
            replace(
                state,
                layer=now.layer,
                blend=now.blend,
                masks_shown=now.masks_shown,
                overlay_opacity=now.overlay_opacity,
                compare=now.compare,
                prompts=tuple(replace(prompt, visible=eyes.get(prompt.text, prompt.visible)) for prompt in state.prompts),
            )
        )

    def _set(self, state: ViewState) -> None:
        before, self.state = self.state, state
        if state != before:
            self.changed.emit(None)
            self.view_changed.emit(before, state)
