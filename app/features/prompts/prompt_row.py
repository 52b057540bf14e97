"""A row of the prompt bar: colour, text, visibility, area and error."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QResizeEvent
from PySide6.QtWidgets import QFrame, QGridLayout, QToolButton, QWidget

from degense.app.features.prompts.prompt_name import PromptName
from degense.widgets import forms
from degense.widgets.colour_menu import colour_menu
from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import PRESS, keep_keys

RIGHT_MARGIN = 4
#: Area and confidence at their longest.
WIDEST = "100.0% · 1.00"


class _Swatch(forms.Painted, QToolButton):
    """A button that shows a colour."""

    def __init__(self, text: str, colour: QColor, parent: QWidget) -> None:
        super().__init__(parent)
        forms.named(self, f"Colour of {text}", "Change the colour").setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.colour = colour
        self.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        keep_keys(self, PRESS)

    def sizeHint(self) -> QSize:
        side = max(20, self.fontMetrics().height() + 4)
        return QSize(side, side)

    def _paint(self, painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        role = self.palette().ColorRole.Accent if self.hasFocus() else self.palette().ColorRole.Mid
        painter.setPen(self.palette().color(role))
        painter.setBrush(self.colour)
        painter.drawRoundedRect(self.rect().adjusted(2, 2, -3, -3), 4, 4)


class PromptRow(QFrame):
    """A chip with swatch, words, sign, eye and cross. Signals are emitted for the user's changes only."""

    toggled = Signal(bool)
    recoloured = Signal(QColor)
    removed = Signal()
    negated = Signal(bool)
    renamed = Signal(str)

    def __init__(self, text: str, colour: QColor, visible: bool, parent: QWidget, negative: bool = False) -> None:
        super().__init__(parent)
        self.setObjectName("chip")
        self.setAccessibleName(f"Prompt {text}")
        self.text = text
        self.error = ""  # why the prompt cannot be decoded; empty when it can
        self.visible = visible  # whether its mask is to be shown
        self.negative = negative  # whether it removes pixels from the others
        self._swatch = _Swatch(text, colour, self)
        self._swatch.setMenu(colour_menu(self, self._recolour))
        self.name = PromptName(text, self)
        self.name.renamed.connect(self.renamed)
        self.answer = forms.label(secondary=True, wrap=False)
        self._sign = GlyphButton("plus", "", self)
        self._sign.clicked.connect(lambda: self._negate(not self.negative))
        self._eye = GlyphButton("eye", "", self)
        self._eye.clicked.connect(lambda: self.toggle(not self.visible))
        self._cross = GlyphButton("cross", f"Remove {text}", self)
        self._cross.clicked.connect(self.removed)
        self._complaint = forms.complaint()
        self._complaint.hide()
        self._note = forms.label(name="How the prompt is understood", secondary=True)
        self._note.hide()
        layout = QGridLayout(self)
        layout.setContentsMargins(6, 3, RIGHT_MARGIN, 3)
        layout.setHorizontalSpacing(6)
        layout.setVerticalSpacing(2)
        layout.setColumnStretch(1, 1)
        for column, widget in enumerate((self._swatch, self.name, self.answer, self._sign, self._eye, self._cross)):
            layout.addWidget(widget, 0, column)
        layout.addWidget(self._complaint, 2, 1, 1, 5)
        layout.addWidget(self._note, 3, 1, 1, 5)
        self._grid, self._apart = layout, False
        self._show_eye()
        self._show_sign()

    @property
    def colour(self) -> QColor:
        return QColor(self._swatch.colour)

    def set_answer(self, area: float | None, confidence: float | None) -> None:
        """Area (share of the frame) and confidence of the mask, both in [0, 1]; None when they are not known."""
        known = area is not None and confidence is not None and not self.negative
        self.answer.setText(f"{area:.1%} · {confidence:.2f}" if known else "")
        self.answer.setToolTip(
            f"The mask covers {area:.1%} of the frame.\nConfidence {confidence:.2f}: the share of it that is expected to be right."
            if known
            else ""
        )

    def _negate(self, negative: bool) -> None:
        self.negative = negative
        self._show_sign()
        self.negated.emit(negative)

    def _show_sign(self) -> None:
        if self.negative:
            self._sign.set_glyph("minus", f"{self.text} is negative: it removes pixels from the masks; press to give it a mask")
        else:
            self._sign.set_glyph("plus", f"{self.text} has a mask; press to make it negative: it then removes pixels from the others")
        self.name.setText(f"not {self.text}" if self.negative else self.text)
        self._swatch.setEnabled(not self.negative)

    def set_note(self, text: str) -> None:
        """Say how the prompt is understood where that is not what was typed; empty: nothing."""
        self._note.setText(text)
        self._note.setVisible(bool(text))

    def set_error(self, message: str) -> None:
        self.error = message
        self._complaint.setText(f"⚠ {message}")
        self._complaint.setVisible(bool(message))
        self._eye.setEnabled(not message)
        self._make_room()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._make_room()

    def _make_room(self) -> None:
        """Area and confidence stand below the name where both have no room beside each other. Height for all lines of the complaint: a
        layout asks a wrapped label for its height before it has its width.
        """
        metrics = self.fontMetrics()
        beside = self._sign.x() - self.name.x() - 2 * self._grid.horizontalSpacing()
        apart = metrics.horizontalAdvance(self.name.text()) + metrics.horizontalAdvance(WIDEST) > beside
        if apart != self._apart:
            self._apart = apart
            self._grid.removeWidget(self.answer)
            self._grid.addWidget(self.answer, *((1, 1, 1, 5) if apart else (0, 2)))
        width = self.width() - self.name.x() - RIGHT_MARGIN
        self._complaint.setMinimumHeight(0)  # which `heightForWidth` would count in
        self._complaint.setMinimumHeight(self._complaint.heightForWidth(width) if self.error else 0)

    def toggle(self, on: bool) -> None:
        """Show or hide the mask, as by hand."""
        self.visible = on
        self._show_eye()
        self.toggled.emit(on)

    def _show_eye(self) -> None:
        self._eye.set_glyph("eye" if self.visible else "eye-off", f"{'Hide' if self.visible else 'Show'} {self.text}")
        self.name.setEnabled(self.visible)

    def _recolour(self, colour: QColor) -> None:
        self._swatch.colour = QColor(colour)
        self._swatch.update()
        self.recoloured.emit(colour)
