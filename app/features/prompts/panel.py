"""The prompt bar: a field with completion, a row for each prompt, the decoder and its threshold."""

from __future__ import annotations

import re
from collections.abc import Sequence

from PySide6.QtCore import QSignalBlocker, QStringListModel, Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QCheckBox, QComboBox, QCompleter, QLabel, QLineEdit, QMenu, QSlider, QWidget

from degense.app.features.prompts.prompt_row import PromptRow
from degense.app.features.prompts.similarity_histogram import SimilarityHistogram
from degense.widgets import forms
from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import ARROWS, PRESS, TYPING, keep_keys
from degense.widgets.theme import class_colour

_STEPS = 1000
HINT = "What to find, “not …”, or a question"
#: How a negative prompt begins, whose pixels are removed from the masks of the others.
NEGATIVE = re.compile(r"(?:-|−|not\s)\s*(?=\S)", re.IGNORECASE)


def read_prompt(text: str, negative: bool = False) -> tuple[str, bool]:
    """The words of what was typed without a “not” before them, and whether the prompt is negative."""
    found = NEGATIVE.match(text)
    return (text[found.end() :], True) if found else (text, negative)


class PromptBar(QWidget):
    """Enter adds a prompt. While one types, printable keys and arrows reach no shortcut. Signals of prompts give their row first."""

    prompt_added = Signal(object)
    prompt_removed = Signal(object)
    prompt_toggled = Signal(object, bool)
    prompt_recoloured = Signal(object, QColor)
    prompt_negated = Signal(object, bool)
    prompt_renamed = Signal(object, str, bool)  # (row, words, negative)
    threshold_changed = Signal(float)
    decoder_changed = Signal(str)
    refined_toggled = Signal(bool)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Prompts")
        self._rows: list[PromptRow] = []
        self._field = forms.named(QLineEdit(self, clearButtonEnabled=True, maxLength=200), "New prompt", HINT)
        self._field.setPlaceholderText(HINT)
        keep_keys(self._field, TYPING)
        self._words = QStringListModel(self)
        completer = QCompleter(self._words, self, caseSensitivity=Qt.CaseSensitivity.CaseInsensitive, filterMode=Qt.MatchFlag.MatchContains)
        self._field.setCompleter(completer)
        # Queued: a word chosen in the completer's list is in the field only after the key press that chose it.
        self._field.returnPressed.connect(self._submit, Qt.ConnectionType.QueuedConnection)
        self._add_button = GlyphButton("plus", "Add the prompt", self)
        self._add_button.clicked.connect(self._submit)
        self._names = QMenu("Names of this run", self)  # what can be asked for without a key
        self._names.triggered.connect(lambda action: self._ask_for(action.text()))
        self._names_button = GlyphButton("down", "Choose a name that this run knows", self, self._show_names)
        self._names_button.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # by keys the names are offered while one types
        self._names_button.hide()

        self._hint = forms.label("No prompts yet", secondary=True)
        self._list = forms.column(self._hint, margin=0, spacing=4)

        self._decoder_box = forms.choice("Decoder of the masks", picked=lambda: self.decoder_changed.emit(self.decoder()))
        self._decoder_box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self._decoder_box.setMinimumContentsLength(8)
        self._refined = QCheckBox("Refined", self)
        self._refined.setToolTip("Average over superpixels and follow the edges of the frame; off: pixel by pixel, coarse")
        self._refined.clicked.connect(self.refined_toggled)
        keep_keys(self._refined, PRESS)
        self.histogram = SimilarityHistogram(self)  # how similar the pixels are to each prompt, above the threshold
        self.histogram.threshold_dragged.connect(self._dragged)
        self.histogram.hide()
        slider, tip = QSlider(Qt.Orientation.Horizontal, self), "Similarity above which a pixel belongs to the mask"
        self._slider = forms.named(slider, "Similarity threshold", tip)
        self._slider.setRange(0, _STEPS)
        self._slider.setSingleStep(_STEPS // 100)
        self._slider.setPageStep(_STEPS // 20)
        self._slider.setMinimumWidth(60)
        self._slider.valueChanged.connect(self._threshold_moved)
        keep_keys(self._slider, ARROWS)
        self._threshold_text = QLabel(self, alignment=Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self._threshold_text.setMinimumWidth(self.fontMetrics().horizontalAdvance("-0.000"))
        forms.column(
            forms.row((self._field, 1), self._names_button, self._add_button, spacing=4),
            self._list,
            forms.row((self._decoder_box, 1), self._refined),
            self.histogram,
            forms.row(QLabel("Threshold"), (self._slider, 1), self._threshold_text),
            0,
            parent=self,
        )
        self._decoder_box.hide()
        self.set_threshold(0.5)

    # Decoder and threshold

    def set_completions(self, words: Sequence[str]) -> None:
        """The names that the run knows: what is offered while one types, and by the button beside the field."""
        self._words.setStringList(list(words))
        self._names.clear()
        for word in words:
            self._names.addAction(word)
        self._names_button.setVisible(bool(words))

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

    def set_decoder(self, name: str) -> None:
        index = self._decoder_box.findData(name)
        if index < 0:
            raise ValueError(f"unknown decoder {name!r}")
        self._decoder_box.setCurrentIndex(index)

    def decoder(self) -> str:
        return self._decoder_box.currentData() or ""

    def set_threshold(self, threshold: float) -> None:
        with QSignalBlocker(self._slider):
            self._slider.setValue(round(threshold * _STEPS))
        self._threshold_text.setText(f"{self.threshold():.3f}")
        self.histogram.set_threshold(self.threshold())

    def threshold(self) -> float:
        return self._slider.value() / _STEPS

    # Prompts

    def add_prompt(self, text: str, colour: QColor | None = None, visible: bool = True, negative: bool = False) -> PromptRow:
        """Add a row silently. The same words again (letter case aside) give the row that is there."""
        text = " ".join(text.split())
        if not text:
            raise ValueError("a prompt has at least one word")
        for row in self._rows:
            if row.text.casefold() == text.casefold():
                return row
        row = PromptRow(text, QColor(colour) if colour is not None else self._free_colour(), visible, self, negative)
        row.toggled.connect(lambda on: self.prompt_toggled.emit(row, on))
        row.recoloured.connect(lambda chosen: self.prompt_recoloured.emit(row, chosen))
        row.negated.connect(lambda on: self.prompt_negated.emit(row, on))
        row.renamed.connect(lambda words: self.prompt_renamed.emit(row, *read_prompt(words, row.negative)))
        row.removed.connect(lambda: self._remove_by_hand(row))
        self._rows.append(row)
        self._list.addWidget(row)
        self._hint.hide()
        return row

    def remove_prompt(self, row: PromptRow) -> None:
        self._rows.remove(row)
        self._list.removeWidget(row)
        row.hide()
        row.deleteLater()
        self._hint.setVisible(not self._rows)

    def clear(self) -> None:
        for row in self.prompts():
            self.remove_prompt(row)

    def prompts(self) -> list[PromptRow]:
        return list(self._rows)

    def focus_prompt(self, text: str) -> None:
        """Give the keyboard to the words of a prompt, when there is a row for it."""
        for row in self._rows:
            if row.text.casefold() == text.casefold():
                row.name.setFocus(Qt.FocusReason.OtherFocusReason)

    def focus_input(self) -> None:
        self._field.setFocus(Qt.FocusReason.ShortcutFocusReason)
        self._field.selectAll()

    # Inside

    def _free_colour(self) -> QColor:
        used = {row.colour.name() for row in self._rows}
        return class_colour(next((i for i in range(len(self._rows) + 1) if class_colour(i).name() not in used), len(self._rows) + 1))

    def _show_names(self) -> None:
        self._names.popup(self._names_button.mapToGlobal(self._names_button.rect().bottomLeft()))

    def _ask_for(self, name: str) -> None:
        self._field.setText(name)
        self._submit()

    def _submit(self) -> None:
        text = self._field.text().strip()
        if not text:
            return
        self._field.clear()
        if popup := self._field.completer().popup():
            popup.hide()  # it would hide the new row
        known = self.prompts()
        words, negative = read_prompt(text)
        row = self.add_prompt(words, negative=negative)
        if row not in known:
            self.prompt_added.emit(row)
        elif not row.visible:
            row.toggle(True)

    def _remove_by_hand(self, row: PromptRow) -> None:
        self.remove_prompt(row)
        self._field.setFocus(Qt.FocusReason.OtherFocusReason)
        self.prompt_removed.emit(row)

    def _dragged(self, threshold: float) -> None:
        self._slider.setValue(round(threshold * _STEPS))

    def _threshold_moved(self) -> None:
        self._threshold_text.setText(f"{self.threshold():.3f}")
        self.histogram.set_threshold(self.threshold())
        self.threshold_changed.emit(self.threshold())
