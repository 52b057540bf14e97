"""The layer list and the colours of the chosen layer: each shows the session's view state and changes it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QWidget

from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.layer_images import get_layer
from degense.app.features.viewer.layer_list import LayerList, LayerRow
from degense.app.features.viewer.view_rendering import View
from degense.app.session.view_state import ViewState
from degense.engine.layer_titles import with_unit
from degense.widgets import forms
from degense.widgets.colour_bar import ColourBar


class LayerControls(QObject):
    """Two-way bindings. After each change the widgets are set from the session; their setters emit nothing."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.session = session = viewer.session
        self.layers, self.colour_bar = LayerList(), ColourBar()
        panel = QWidget()
        forms.column(self.layers, self.colour_bar, 0, parent=panel)
        self.dock = viewer.shell.add_dock("Layers", panel, "right", height=300)
        layers, view = self.layers, session.view
        layers.chosen.connect(view.choose_layer)
        layers.shown_alone.connect(view.set_layer)
        layers.toggled.connect(self._toggle)
        layers.opacity_changed.connect(view.set_layer_opacity)
        layers.moved.connect(view.move_layer)
        layers.masks_toggled.connect(view.set_masks_shown)
        layers.masks_opacity_changed.connect(view.set_overlay_opacity)
        self.colour_bar.changed.connect(self._set_range)
        session.opened.connect(self._opened)
        session.view_state_changed.connect(lambda before, after: self._show(after))
        viewer.drawn.connect(self._show_span)
        self._opened()

    def _opened(self) -> None:
        scene = self.session.scene
        self.dock.setEnabled(scene is not None)
        self.colour_bar.setEnabled(False)  # until a layer of numbers is shown
        if scene is not None:
            from degense.engine.layers import LAYERS

            self.layers.set_titles([(layer.name, layer.title, layer.unit(scene), layer.description) for layer in LAYERS.values()])
            self._show(self.session.view_state)

    def _toggle(self, layer: str, visible: bool) -> None:
        self.session.view.set_layer_visible(layer, visible)
        self._show(self.session.view_state)  # also where nothing changed: the last layer stays

    def _show(self, state: ViewState) -> None:
        scene = self.session.scene
        if scene is None:
            return
        from degense.engine.layers import LAYERS

        texts = tuple(prompt.text for prompt in state.visible_prompts)
        self.layers.set_available({layer.name: layer.missing(scene, texts) for layer in LAYERS.values()})
        drawn = {blend.name for blend in state.drawn}
        rows = [LayerRow(blend.name, blend.name in drawn, blend.opacity) for blend in state.blend]
        self.layers.set_layers(rows, state.layer, (state.masks_shown, state.overlay_opacity))
        layer, chosen = get_layer(state.layer), state.range(state.layer)
        self.colour_bar.setEnabled(layer.kind == "scalar")
        self.colour_bar.set_title(with_unit(layer.title, layer.unit(scene)))
        self.colour_bar.set_cmap(chosen.cmap or layer.cmap)
        self.colour_bar.set_range_mode(chosen.mode)
        self.colour_bar.set_clip(chosen.clip)

    def _show_span(self, view: View) -> None:
        span = view.spans.get(self.session.view_state.layer)
        if span is not None:
            self.colour_bar.set_range(*span)

    def _set_range(self, changes: dict[str, Any]) -> None:
        layer = self.session.view_state.layer
        self.session.view.set_range(layer, replace(self.session.view_state.range(layer), **changes))
