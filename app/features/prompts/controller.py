"""The prompt bar: it shows the session's prompts and changes them."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject
from PySide6.QtGui import QColor

from degense.app.features.prompts.panel import PromptBar
from degense.app.features.prompts.prompt_row import PromptRow
from degense.app.session.targets import Spot
from degense.app.session.view_state import ViewState, decoder_refined
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.widgets.qt_images import rgb

DECODER_WORDS = {
    "rnse": ("Regions", "Similarity averaged over superpixels, edges taken from the frame, holes filled; other classes keep theirs."),
    "rnse+argmax": ("Regions, best class", "As regions, but half the threshold is enough where the prompt beats all other classes."),
    "rnse-paper": (
        "Regions, as published",
        "The mean similarity of each superpixel, edges taken from the frame, must exceed the threshold.",
    ),
    "argmax": ("Best class", "Pixels where the prompt beats all other classes."),
    "threshold": ("Plain threshold", "Pixels whose similarity exceeds the threshold."),
}


class PromptControls(QObject):
    """Two-way bindings. After each change the bar is set from the session; its setters emit nothing."""

    def __init__(self, shell: Shell) -> None:
        super().__init__(shell)
        self.shell, self.session, self.bar = shell, shell.session, PromptBar()
        self.dock = shell.add_dock("Prompts", self.bar, "right", height=280)
        self._bind_prompts()
        self.session.opened.connect(self._opened)
        self.session.view_state_changed.connect(lambda before, after: self._show(after))
        self._opened()

    def focus(self) -> None:
        self.shell.docks.bring(self.dock)
        self.bar.focus_input()

    def can_add_example(self) -> bool:
        """Whether a place is followed, whose look can be added to a prompt."""
        scene = self.session.scene
        return scene is not None and scene.has_semantics and isinstance(self.session.probe, Spot)

    def add_example(self) -> None:
        """Let the last visible prompt also find what looks like the place that was clicked."""
        spot = self.session.probe
        assert isinstance(spot, Spot)
        added = self.session.view.add_example(spot.frame, int(spot.x), int(spot.y))
        self.shell.say(f"“{added.text}” also finds what looks like this place.")

    def _opened(self) -> None:
        scene = self.session.scene
        self.dock.setEnabled(scene is not None)
        self.bar.clear()
        if scene is not None:
            from degense.engine.semantics.prompts import DECODERS

            self.bar.set_decoders([(name, *DECODER_WORDS[name]) for name in DECODERS])
            self.bar.set_completions(list(scene.classes))
            self._show(self.session.view_state)

    def _show(self, state: ViewState) -> None:
        if self.session.scene is not None:
            self.bar.set_threshold(state.threshold)
            self.bar.set_decoder(state.decoder)
            self.bar.set_refined(decoder_refined(state.decoder, True) == state.decoder)
            self._show_prompts(state)

    def _bind_prompts(self) -> None:
        view, bar = self.session.view, self.bar
        bar.prompt_added.connect(self._prompt_added)
        bar.prompt_removed.connect(lambda row: self._edit(view.remove_prompt, row))
        bar.prompt_toggled.connect(lambda row, visible: self._edit(view.set_visible, row, visible))
        bar.prompt_recoloured.connect(lambda row, colour: self._edit(view.set_colour, row, rgb(colour)))
        bar.prompt_negated.connect(lambda row, negative: self._edit(view.set_negative, row, negative))
        bar.prompt_renamed.connect(self._prompt_renamed)
        bar.refined_toggled.connect(view.set_refined)
        bar.threshold_changed.connect(view.set_threshold)
        bar.decoder_changed.connect(view.set_decoder)

    def _prompt_added(self, row: PromptRow) -> None:
        try:
            self.session.view.add_prompt(row.text, rgb(row.colour), row.negative)
        except DegenseError as error:
            row.set_error(str(error))
        else:
            self._note_corrections()

    def _prompt_renamed(self, row: PromptRow, words: str, negative: bool) -> None:
        view = self.session.view
        try:
            if row.error:  # it was never one of the session's prompts
                view.add_prompt(words, rgb(row.colour), negative)
            else:
                view.rename_prompt(row.text, words, negative)
        except DegenseError as error:
            row.set_note(str(error))
        else:
            self.bar.focus_prompt(words)

    def can_toggle(self, place: int) -> bool:
        return self.session.has_scene() and place < len(self.session.view_state.prompts)

    def is_shown(self, place: int) -> bool:
        return self.can_toggle(place) and self.session.view_state.prompts[place].visible

    def toggle(self, place: int) -> None:
        """Show or hide the prompt at a place of the list, 0 the first."""
        prompt = self.session.view_state.prompts[place]
        self.session.view.set_visible(prompt.text, not prompt.visible)

    def _note_corrections(self) -> None:
        """Show in each row which words were misspelt: graspr → grasper. Words in quotes and the run's own classes are meant as typed."""
        from degense.engine.vocabulary.concepts import surgical_vocabulary

        classes = {name.casefold() for name in self.session.scene.classes} if self.session.scene is not None else set()
        for row in self.bar.prompts():
            typed = not row.error and row.text[0] not in '"“' and row.text.casefold() not in classes
            pairs = surgical_vocabulary().corrections(row.text) if typed else []
            row.set_note(", ".join(f"{word} → {name}" for word, name in pairs))

    def _edit(self, change: Callable[..., None], row: PromptRow, *values: object) -> None:
        """Change the prompt of a row, when it is one of the session and not one that could not be decoded."""
        if any(prompt.text.casefold() == row.text.casefold() for prompt in self.session.view_state.prompts):
            change(row.text, *values)

    def _show_prompts(self, view_state: ViewState) -> None:
        """Make the chips those of the view state. Chips that could not be decoded stay until the next change of the list."""
        bar = self.bar
        shown = [(prompt.text, rgb(prompt.colour), prompt.visible, prompt.negative) for prompt in bar.prompts() if not prompt.error]
        wanted = [(prompt.text, prompt.colour, prompt.visible, prompt.negative) for prompt in view_state.prompts]
        if [(text.casefold(), *rest) for text, *rest in shown] != [(text.casefold(), *rest) for text, *rest in wanted]:
            bar.clear()
            for text, colour, *rest in wanted:
                bar.add_prompt(text, QColor(*colour), *rest)
            self._note_corrections()
