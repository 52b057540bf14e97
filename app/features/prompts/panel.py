"""The prompt bar: a field with completion, a row for each prompt, the decoder and its threshold."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import QStringListModel, Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QCheckBox, QCompleter, QLabel, QLineEdit, QSlider, QWidget

from degense.app.features.prompts.prompt_row import PromptRow
from degense.app.features.prompts.similarity_histogram import SimilarityHistogram
from degense.widgets import forms
from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import ARROWS, PRESS, TYPING, keep_keys
from degense.widgets.theme import class_colour

_STEPS = 1000
#: How a negative prompt begins, whose pixels are removed from the masks of the others.
NEGATIVE = re.compile(r"(?:-|−|not\s)\s*(?=\S)", re.IGNORECASE)


@dataclass(frozen=True)
class PromptChip:
    """A prompt as the bar shows it; `error` is empty when it can be decoded."""

    id: int
    text: str
    colour: QColor
    visible: bool
    error: str
    negative: bool = False


class PromptBar(QWidget):
    """Enter adds a prompt. While one types, printable keys and arrows reach no shortcut."""

    prompt_added = Signal(int, str)
    prompt_removed = Signal(int)
    prompt_toggled = Signal(int, bool)
    prompt_recoloured = Signal(int, QColor)
    prompt_negated = Signal(int, bool)
    threshold_changed = Signal(float)
    decoder_changed = Signal(str)
    refined_toggled = Signal(bool)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Prompts")
        self._rows: dict[int, PromptRow] = {}
        self._next_id = 0

        self._field = QLineEdit(self)
        self._field.setAccessibleName("New prompt")
        self._field.setPlaceholderText("Name what to find (or “not …”), then Enter")
        self._field.setClearButtonEnabled(True)
        self._field.setMaxLength(200)
        keep_keys(self._field, TYPING)
        self._words = QStringListModel(self)
        completer = QCompleter(self._words, self)
        completer.setCaseSensitivity(Qt.CaseSensitivity.CaseInsensitive)
        completer.setFilterMode(Qt.MatchFlag.MatchContains)
        self._field.setCompleter(completer)
        # Queued: a word chosen in the completer's list is in the field only after the key press that chose it.
        self._field.returnPressed.connect(self._submit, Qt.ConnectionType.QueuedConnection)
        self._add_button = GlyphButton("plus", "Add the prompt", self)
        self._add_button.clicked.connect(self._submit)

        self._hint = forms.label("No prompts yet", secondary=True)
        self._list = forms.column(self._hint, margin=0, spacing=4)

        self._decoder_box = forms.choice("Decoder of the masks", picked=lambda: self.decoder_changed.emit(self.decoder()))
        self._refined = QCheckBox("Refined", self)
        self._refined.setToolTip("Average over superpixels and follow the edges of the frame; off: pixel by pixel, coarse")
        self._refined.clicked.connect(self.refined_toggled)
        keep_keys(self._refined, PRESS)
        self._histogram = SimilarityHistogram(self)
        self._histogram.threshold_dragged.connect(self._dragged)
        self._histogram.hide()
        self._slider = QSlider(Qt.Orientation.Horizontal, self)
        self._slider.setAccessibleName("Similarity threshold")
        self._slider.setToolTip("Similarity above which a pixel belongs to the mask")
        self._slider.setRange(0, _STEPS)
        self._slider.setSingleStep(_STEPS // 100)
        self._slider.setPageStep(_STEPS // 20)
        self._slider.setMinimumWidth(60)
        self._slider.valueChanged.connect(self._threshold_moved)
        keep_keys(self._slider, ARROWS)
        self._threshold_text = QLabel(self)
        self._threshold_text.setMinimumWidth(self.fontMetrics().horizontalAdvance("-0.000"))
        self._threshold_text.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self._arrange()
        self._decoder_box.hide()
        self.set_threshold(0.5)

    def _arrange(self) -> None:
        forms.column(
            forms.row((self._field, 1), self._add_button, spacing=4),
            self._list,
            forms.row((self._decoder_box, 1), self._refined),
            self._histogram,
            forms.row(QLabel("Threshold"), (self._slider, 1), self._threshold_text),
            0,
            parent=self,
        )

    # Decoder and threshold

    def set_completions(self, words: Sequence[str]) -> None:
        """Words that the field proposes."""
        self._words.setStringList(list(words))

    def set_decoders(self, decoders: Sequence[tuple[str, str, str]]) -> None:
        """The decoders on offer: (name, title, description)."""
        self._decoder_box.clear()
        for i, (name, title, description) in enumerate(decoders):
            self._decoder_box.addItem(title, name)
            self._decoder_box.setItemData(i, description, Qt.ItemDataRole.ToolTipRole)
        self._decoder_box.setVisible(bool(decoders))

    def set_refined(self, on: bool) -> None:
        """Whether the decoder works on superpixels."""
        self._refined.setChecked(on)

    def set_histograms(self, curves: Sequence[tuple[np.ndarray, QColor]]) -> None:
        """How similar the pixels are to each prompt (counts over equal steps from 0 to 1), above the threshold."""
        self._histogram.set_curves(curves)

    def histogram(self) -> SimilarityHistogram:
        return self._histogram

    def set_answer(self, id_: int, area: float | None, confidence: float | None) -> None:
        """Area and confidence of a mask, both in [0, 1]; None when they are not known."""
        self._rows[id_].set_answer(area, confidence)

    def answers(self) -> list[str]:
        """Area and confidence of each prompt, as written."""
        return [row.answer() for row in self._rows.values()]

    def set_decoder(self, name: str) -> None:
        index = self._decoder_box.findData(name)
        if index < 0:
            raise ValueError(f"unknown decoder {name!r}")
        self._decoder_box.setCurrentIndex(index)

    def decoder(self) -> str:
        return self._decoder_box.currentData() or ""

    def set_threshold(self, threshold: float) -> None:
        self._slider.blockSignals(True)
        self._slider.setValue(round(threshold * _STEPS))
        self._slider.blockSignals(False)
        self._threshold_text.setText(f"{self.threshold():.3f}")
        self._histogram.set_threshold(self.threshold())

    def threshold(self) -> float:
        return self._slider.value() / _STEPS

    # Prompts

    def add_prompt(self, text: str, colour: QColor | None = None, visible: bool = True, negative: bool = False) -> int:
        """Add a row silently and return its id. The same words again (letter case aside) give the row that is there."""
        text = " ".join(text.split())
        if not text:
            raise ValueError("a prompt has at least one word")
        for id_, row in self._rows.items():
            if row.text.casefold() == text.casefold():
                return id_
        id_, self._next_id = self._next_id, self._next_id + 1
        row = PromptRow(text, QColor(colour) if colour is not None else self._free_colour(), visible, self, negative)
        row.toggled.connect(lambda on: self.prompt_toggled.emit(id_, on))
        row.recoloured.connect(lambda chosen: self.prompt_recoloured.emit(id_, chosen))
        row.negated.connect(lambda on: self.prompt_negated.emit(id_, on))
        row.removed.connect(lambda: self._remove_by_hand(id_))
        self._rows[id_] = row
        self._list.addWidget(row)
        self._hint.hide()
        return id_

    def remove_prompt(self, id_: int) -> None:
        row = self._rows.pop(id_)
        self._list.removeWidget(row)
        row.hide()
        row.deleteLater()
        self._hint.setVisible(not self._rows)

    def clear(self) -> None:
        for id_ in list(self._rows):
            self.remove_prompt(id_)

    def set_error(self, id_: int, message: str) -> None:
        """Why a prompt cannot be decoded; empty when it can."""
        self._rows[id_].set_error(message)

    def prompts(self) -> list[PromptChip]:
        return [PromptChip(id_, row.text, row.colour, row.visible_in_view(), row.error, row.negative) for id_, row in self._rows.items()]

    def focus_input(self) -> None:
        self._field.setFocus(Qt.FocusReason.ShortcutFocusReason)
        self._field.selectAll()

    # Inside

    def _free_colour(self) -> QColor:
        used = {row.colour.name() for row in self._rows.values()}
        index = next((i for i in range(len(self._rows) + 1) if class_colour(i).name() not in used), self._next_id)
        return class_colour(index)

    def _submit(self) -> None:
        text = self._field.text().strip()
        if not text:
            return
        self._field.clear()
        if popup := self._field.completer().popup():
            popup.hide()  # it would hide the new row
        known = set(self._rows)
        negative = NEGATIVE.match(text)
        id_ = self.add_prompt(text[negative.end() :] if negative else text, negative=negative is not None)
        if id_ not in known:
            self.prompt_added.emit(id_, self._rows[id_].text)
        elif not self._rows[id_].visible_in_view():
            self._rows[id_].show_by_hand()

    def _remove_by_hand(self, id_: int) -> None:
        self.remove_prompt(id_)
        self._field.setFocus(Qt.FocusReason.OtherFocusReason)
        self.prompt_removed.emit(id_)

    def _dragged(self, threshold: float) -> None:
        self._slider.setValue(round(threshold * _STEPS))

    def _threshold_moved(self) -> None:
        self._threshold_text.setText(f"{self.threshold():.3f}")
        self._histogram.set_threshold(self.threshold())
        self.threshold_changed.emit(self.threshold())
