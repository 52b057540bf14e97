"""The dialog of a movie: what it shows side by side, from where, how large and how fast."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QCheckBox, QDialogButtonBox, QFormLayout, QGridLayout, QPushButton, QStyle, QWidget

from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.anonymise.box import AnonymiseBox
from degense.app.features.cameras.state import Stop
from degense.app.features.movies.layer_stack import LayerStack
from degense.app.features.movies.movie import FLIGHT_FPS, LARGEST_SIDE, MOST_FPS, MOST_LAYERS, RECORDING, MovieOptions, plan
from degense.app.session.view_state import ViewState
from degense.engine.errors import DegenseError
from degense.widgets import forms
from degense.widgets.keys import PRESS, keep_keys
from degense.widgets.scrolling import scrolled

if TYPE_CHECKING:
    from degense.engine.scene import Scene

SURGEON, FLIGHT, FLIGHT_WHOLE = "surgeon", "kept", "whole"
COLUMNS = 3  # of the layers, where there is room


class MovieDialog(forms.Dialog):
    """Asks for `MovieOptions`; `write` gets them with the file, once one is chosen by `ask_save`."""

    def __init__(
        self,
        parent: QWidget,
        scene: Scene,
        view_state: ViewState,
        stops: tuple[Stop, ...],
        anonymise: AnonymiseBox,
        ask_save: Callable[[str, str, str], Path | None],
        write: Callable[[Path, MovieOptions, Anonymity], None],
    ) -> None:
        super().__init__(parent, "movie", "Movie", 560, 420)
        self._scene, self._view_state, self._stops, self._ask_save, self._write = scene, view_state, stops, ask_save, write
        self.anonymise = anonymise
        self.layers = self._layer_boxes()
        cameras = [(SURGEON, "the surgeon’s camera")]
        if len(stops) > 1:
            cameras.append((FLIGHT, "along the kept cameras, at their instants"))
            cameras.append((FLIGHT_WHOLE, "along the kept cameras, while all time runs"))
        self.camera = forms.choice("Camera of the movie", cameras)
        width, height = scene.clip_size
        self.picture_width, self.picture_height = forms.number("Width", 16, LARGEST_SIDE), forms.number("Height", 16, LARGEST_SIDE)
        self.picture_width.setValue(width)
        self.picture_height.setValue(height)
        twice = forms.button("× 2", self._double, "Twice as large")
        twice.setAutoDefault(False)
        self.fps = forms.decimal("Frames a second", 0.1, MOST_FPS)
        self.titled = QCheckBox("names of the layers and colour bars")
        self.titled.setChecked(True)
        keep_keys(self.titled, PRESS)
        self.sentence, self.complaint = forms.label(name="What will be written"), forms.complaint()
        buttons = self.closing()
        self.start = QPushButton("Save…")
        self.start.setDefault(True)
        self.start.clicked.connect(self._save)
        buttons.addButton(self.start, QDialogButtonBox.ButtonRole.ActionRole)
        form = self._form(twice)
        area = scrolled(form)
        area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        area.setMinimumWidth(form.minimumSizeHint().width() + self.style().pixelMetric(QStyle.PixelMetric.PM_ScrollBarExtent))
        forms.column((area, 1), self.sentence, self.complaint, buttons, margin=12, parent=self)
        self.camera.currentIndexChanged.connect(self._propose_fps)
        fields: tuple[QWidget, ...] = (self.camera, self.picture_width, self.picture_height, self.fps, self.titled)
        for control in (*self.layers.values(), *fields):
            forms.changed(control).connect(lambda *value: self._show())
        anonymise.changed.connect(self._show)
        self._propose_fps()
        self._show()

    def _layer_boxes(self) -> dict[str, QCheckBox]:
        """A box for the recording, what the view blends, and each layer that the scene can show; what is shown is ticked."""
        from degense.engine.layers import LAYERS

        prompts = tuple(prompt.text for prompt in self._view_state.visible_prompts)
        boxes = {RECORDING: QCheckBox("Recording")} if self._scene.clip is not None else {}
        there = {name: layer.title for name, layer in LAYERS.items() if not layer.missing(self._scene, prompts)}
        drawn, shown = [blend for blend in self._view_state.drawn if blend.name in there], self._view_state.layer
        if len(drawn) > 1:
            stack = LayerStack.of(drawn)
            shown = str(stack)
            boxes[shown] = QCheckBox(f"As shown: {stack.title}")
        boxes |= {name: QCheckBox(title) for name, title in there.items()}
        for name, box in boxes.items():
            box.setChecked(name == shown)
            keep_keys(box, PRESS)
        return boxes

    def _form(self, twice: QWidget) -> QWidget:
        sizes, boxes, page = QWidget(), QWidget(), QWidget()
        form = QFormLayout(page)
        form.setContentsMargins(0, 0, 0, 0)
        forms.row(self.picture_width, forms.label("×", wrap=False), self.picture_height, twice, 0, spacing=6, parent=sizes)
        grid = QGridLayout(boxes)
        grid.setContentsMargins(0, 0, 0, 0)
        blends, alone = ([box for name, box in self.layers.items() if ("+" in name) is blend] for blend in (True, False))
        room = self.screen().availableSize().width() - 2 * self.fontMetrics().horizontalAdvance("Frames a second")
        columns = min(COLUMNS, max(1, room // max(box.sizeHint().width() + grid.horizontalSpacing() for box in alone)))
        for place, box in enumerate(alone):
            grid.addWidget(box, place // columns, place % columns)
        for row, box in enumerate(blends, -(-len(alone) // columns)):
            grid.addWidget(box, row, 0, 1, columns)
        rows = (("Show", boxes), ("From", self.camera), ("Each picture", sizes), ("Frames a second", self.fps), ("With", self.titled))
        for words, field in (*rows, ("Anonymise", self.anonymise)):
            form.addRow(words, field)
        return page

    def options(self) -> MovieOptions:
        """What is chosen. DegenseError when it cannot be."""
        camera = forms.value(self.camera)
        if camera != SURGEON and self.anonymise.value().covering:
            raise DegenseError("What is burnt in can be blacked out only as the surgeon’s camera sees it.")
        return MovieOptions(
            view_state=self._view_state,
            layers=tuple(name for name, box in self.layers.items() if box.isChecked()),
            size=(self.picture_width.value(), self.picture_height.value()),
            fps=self.fps.value(),
            stops=() if camera == SURGEON else self._stops,
            flight_time="whole" if camera == FLIGHT_WHOLE else "kept",
            titled=self.titled.isChecked(),
        )

    def _double(self) -> None:
        self.picture_width.setValue(2 * self.picture_width.value())
        self.picture_height.setValue(2 * self.picture_height.value())

    def _propose_fps(self) -> None:
        self.fps.setValue(self._scene.fps if forms.value(self.camera) == SURGEON else FLIGHT_FPS)

    def _show(self) -> None:
        """Say what will be written, or why it cannot be."""
        try:
            options = self.options()
        except DegenseError as error:
            few = not any(box.isChecked() for box in self.layers.values())
            self.sentence.clear()
            self.complaint.setText(f"Choose 1 to {MOST_LAYERS} layers." if few else str(error))
            self.start.setEnabled(False)
            return
        (shots, fps), count = plan(self._scene, options), len(options.layers)
        side = f"{count} pictures side by side" if count > 1 else "one picture"
        self.sentence.setText(f"{len(shots) / fps:.3g} seconds, {len(shots):,} frames, {side}.")
        self.complaint.clear()
        self.start.setEnabled(True)

    def _save(self) -> None:
        options = self.options()
        hidden = self.anonymise.value()
        name = "-".join([hidden.name(self._scene.name), *(re.sub(r":[^+]*", "", layer) for layer in options.layers)])
        out = self._ask_save("Save the movie", f"{name}.mp4", "Movie (*.mp4)")
        if out is not None:
            self.accept()
            self._write(out, options, hidden)
