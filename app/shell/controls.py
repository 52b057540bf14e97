"""Prompts, layers, colour bar and timeline: each shows the session and changes it."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

from PySide6.QtCore import QObject
from PySide6.QtGui import QColor

from degense.app.features.viewer.pictures import get_layer
from degense.app.session.playback import Playback
from degense.app.session.session import Session
from degense.app.session.view_state import Colour, ColourRange, RangeMode, ViewState, decoder_refined
from degense.app.shell.parts import Parts
from degense.app.shell.settings import SettingsFile
from degense.engine.errors import DegenseError

DECODER_WORDS = {
    "rnse": ("Regions", "Similarity averaged over superpixels, edges taken from the picture, holes filled; other classes keep theirs."),
    "rnse+argmax": ("Regions, best class", "As regions, but half the threshold is enough where the prompt beats all other classes."),
    "argmax": ("Best class", "Pixels where the prompt beats all other classes."),
    "threshold": ("Plain threshold", "Pixels whose similarity exceeds the threshold."),
}


class Controls(QObject):
    """Two-way bindings. The session is the truth: after each change the widgets are set from it, and their setters emit nothing."""

    def __init__(self, session: Session, settings: SettingsFile, parts: Parts, playback: Playback) -> None:
        super().__init__(parts)
        self.session, self.settings, self.parts, self.playback = session, settings, parts, playback
        self._texts: dict[int, str] = {}
        session.opened.connect(self._opened)
        session.view_state_changed.connect(lambda before, after: self._show(after))
        self._bind_timeline()
        self._bind_prompts()
        self._bind_layers()
        self._bind_history()
        self._opened()

    def _opened(self) -> None:
        session, parts = self.session, self.parts
        scene, clip = session.scene, session.clip
        parts.timeline.set_frames(session.frames, scene.fps if scene else clip.fps if clip else 25.0)
        self._show_playback()
        parts.timeline.set_marks(clip.test_frames if clip else (), clip.labelled_frames if clip else ())
        for dock in (parts.layers_dock, parts.prompts_dock, parts.probe_dock):
            dock.setEnabled(scene is not None)
        parts.colour_bar.hide()  # until a layer of numbers is shown
        parts.prompts.clear()
        self._texts.clear()
        if scene is not None:
            from degense.engine.layers import LAYERS
            from degense.engine.semantics.prompts import DECODERS

            parts.layers.set_layers([(layer.name, layer.title, layer.unit(scene), layer.description) for layer in LAYERS.values()])
            parts.prompts.set_decoders([(name, *DECODER_WORDS[name]) for name in DECODERS])
            parts.prompts.set_completions(list(scene.classes))
            self._show(session.view_state)

    def _show(self, view_state: ViewState) -> None:
        """Set every widget from the look."""
        scene, parts = self.session.scene, self.parts
        if scene is None:
            return
        from degense.engine.layers import LAYERS

        texts = tuple(prompt.text for prompt in view_state.visible_prompts)
        for layer in LAYERS.values():
            missing = layer.missing(scene, texts)
            parts.layers.set_available(layer.name, not missing, missing)
        parts.layers.set_current(view_state.layer)
        parts.layers.set_opacity(view_state.overlay_opacity)
        parts.layers.set_masks_shown(view_state.masks_shown)
        parts.prompts.set_threshold(view_state.threshold)
        parts.prompts.set_decoder(view_state.decoder)
        parts.prompts.set_refined(decoder_refined(view_state.decoder, True) == view_state.decoder)
        self._show_prompts(view_state)
        layer = get_layer(view_state.layer)
        chosen = view_state.range(view_state.layer)
        parts.colour_bar.set_title(layer.title)
        parts.colour_bar.set_cmap(chosen.cmap or layer.cmap)
        parts.colour_bar.set_range_mode(chosen.mode)
        parts.colour_bar.set_clip(chosen.clip)

    # Timeline

    def _bind_timeline(self) -> None:
        session, timeline = self.session, self.parts.timeline
        timeline.frame_changed.connect(session.go_to)
        timeline.playing_changed.connect(lambda playing: session.play() if playing else session.pause())
        timeline.speed_changed.connect(lambda speed: self.settings.update(speed=speed))
        session.frame_changed.connect(timeline.set_frame)
        session.playing_changed.connect(self._follow_playing)
        timeline.set_speed(self.settings.value.speed)
        timeline.loop_mode_changed.connect(self.playback.set_mode)
        self.playback.changed.connect(lambda record: self._show_playback())

    def _show_playback(self) -> None:
        timeline, playback = self.parts.timeline, self.playback
        timeline.set_loop_mode(playback.mode)
        timeline.set_played(playback.first, playback.last)

    def _follow_playing(self, playing: bool) -> None:
        timeline = self.parts.timeline
        if playing != timeline.is_playing():
            timeline.play() if playing else timeline.pause()

    # Prompts

    def _bind_prompts(self) -> None:
        session, bar = self.session, self.parts.prompts
        bar.prompt_added.connect(self._prompt_added)
        bar.prompt_removed.connect(self._prompt_removed)
        bar.prompt_toggled.connect(self._prompt_toggled)
        bar.prompt_recoloured.connect(self._recoloured)
        bar.prompt_negated.connect(self._negated)
        bar.refined_toggled.connect(session.set_refined)
        bar.threshold_changed.connect(session.set_threshold)
        bar.decoder_changed.connect(session.set_decoder)

    def _answered(self, number: int) -> bool:
        """Whether a chip stands for a prompt of the session, not for one that could not be answered."""
        text = self._texts.get(number, "").casefold()
        return any(prompt.text.casefold() == text for prompt in self.session.view_state.prompts)

    def _prompt_added(self, number: int, text: str) -> None:
        bar = self.parts.prompts
        chip = next(prompt for prompt in bar.prompts() if prompt.id == number)
        self._texts[number] = text
        try:
            self.session.add_prompt(text, rgb(chip.colour), chip.negative)
        except DegenseError as error:
            bar.set_error(number, str(error))

    def _prompt_removed(self, number: int) -> None:
        if self._answered(number):
            text = self._texts.pop(number)
            self.session.remove_prompt(text)
        self._texts.pop(number, None)

    def _prompt_toggled(self, number: int, visible: bool) -> None:
        if self._answered(number):
            self.session.set_visible(self._texts[number], visible)

    def _negated(self, number: int, negative: bool) -> None:
        if self._answered(number):
            self.session.set_negative(self._texts[number], negative)

    def _recoloured(self, number: int, colour: QColor) -> None:
        if self._answered(number):
            self.session.set_colour(self._texts[number], rgb(colour))

    def _show_prompts(self, view_state: ViewState) -> None:
        """Make the chips those of the look. Chips that could not be answered stay until the next change of the list."""
        bar = self.parts.prompts
        shown = [(prompt.text, rgb(prompt.colour), prompt.visible, prompt.negative) for prompt in bar.prompts() if not prompt.error]
        wanted = [(prompt.text, prompt.colour, prompt.visible, prompt.negative) for prompt in view_state.prompts]
        if [(text.casefold(), *rest) for text, *rest in shown] != [(text.casefold(), *rest) for text, *rest in wanted]:
            bar.clear()
            self._texts = {bar.add_prompt(text, QColor(*colour), *rest): text for text, colour, *rest in wanted}

    # History

    def _bind_history(self) -> None:
        undo, history = self.session.undo, self.parts.history
        history.position_chosen.connect(undo.go_to)
        undo.changed.connect(lambda: history.set_entries(undo.entries, undo.position))

    # Layers and colours

    def _bind_layers(self) -> None:
        session, layers, bar = self.session, self.parts.layers, self.parts.colour_bar
        layers.layer_changed.connect(session.set_layer)
        layers.opacity_changed.connect(session.set_overlay_opacity)
        layers.masks_toggled.connect(session.set_masks_shown)
        bar.range_mode_changed.connect(self._range_mode_changed)
        bar.range_edited.connect(lambda low, high: self._set_range(mode="fixed", low=low, high=high))
        bar.cmap_changed.connect(lambda cmap: self._set_range(cmap=cmap))
        bar.clip_changed.connect(lambda clip: self._set_range(clip=clip))

    def _range_mode_changed(self, mode: str) -> None:
        if mode in get_args(RangeMode):
            low, high = self.parts.colour_bar.range()
            self._set_range(mode=mode, low=low, high=high)

    def _set_range(self, **changes: object) -> None:
        layer = self.session.view_state.layer
        chosen: ColourRange = replace(self.session.view_state.range(layer), **changes)  # type: ignore[arg-type]
        self.session.set_range(layer, chosen)


def rgb(colour: QColor) -> Colour:
    return colour.red(), colour.green(), colour.blue()
