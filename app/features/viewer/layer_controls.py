"""The layer list and the colour bar: each shows the session's view state and changes it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QSizePolicy, QWidget

from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.layer_images import get_layer
from degense.app.features.viewer.layer_list import LayerList
from degense.app.features.viewer.view_rendering import View
from degense.app.session.view_state import ViewState
from degense.widgets import forms
from degense.widgets.colour_bar import ColourBar


class LayerControls(QObject):
    """Two-way bindings. After each change the widgets are set from the session; their setters emit nothing."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.session = session = viewer.session
        self.layers, self.colour_bar = LayerList(), ColourBar()
        self.colour_bar.hide()
        panel = QWidget()
        panel.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Maximum)
        forms.column(self.layers, self.colour_bar, 0, parent=panel)
        self.dock = viewer.shell.add_dock("Layers", panel, "right", height=240)
        layers, bar = self.layers, self.colour_bar
        layers.layer_changed.connect(session.view.set_layer)
        layers.opacity_changed.connect(session.view.set_overlay_opacity)
        layers.masks_toggled.connect(session.view.set_masks_shown)
        bar.changed.connect(self._set_range)
        session.opened.connect(self._opened)
        session.view_state_changed.connect(lambda before, after: self._show(after))
        viewer.drawn.connect(self._show_span)
        self._opened()

    def _opened(self) -> None:
        scene = self.session.scene
        self.dock.setEnabled(scene is not None)
        self.colour_bar.hide()  # until a layer of numbers is shown
        if scene is not None:
            from degense.engine.layers import LAYERS

            self.layers.set_layers([(layer.name, layer.title, layer.unit(scene), layer.description) for layer in LAYERS.values()])
            self._show(self.session.view_state)

    def _show(self, state: ViewState) -> None:
        scene = self.session.scene
        if scene is None:
            return
        from degense.engine.layers import LAYERS

        texts = tuple(prompt.text for prompt in state.visible_prompts)
        for layer in LAYERS.values():
            missing = layer.missing(scene, texts)
            self.layers.set_available(layer.name, not missing, missing)
        self.layers.set_current(state.layer)
        self.layers.set_opacity(state.overlay_opacity)
        self.layers.set_masks_shown(state.masks_shown)
        layer, chosen = get_layer(state.layer), state.range(state.layer)
        self.colour_bar.set_title(layer.title, layer.unit(scene))
        self.colour_bar.set_cmap(chosen.cmap or layer.cmap)
        self.colour_bar.set_range_mode(chosen.mode)
        self.colour_bar.set_clip(chosen.clip)

    def _show_span(self, view: View) -> None:
        if view.span is not None:
            self.colour_bar.set_range(*view.span, view.beyond)
            self.colour_bar.set_cmap(view.cmap)
        self.colour_bar.setVisible(view.span is not None)

    def _set_range(self, changes: dict[str, Any]) -> None:
        layer = self.session.view_state.layer
        self.session.view.set_range(layer, replace(self.session.view_state.range(layer), **changes))
