"""The words of a prompt in its row: read, and written anew where they stand."""

from __future__ import annotations

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QMouseEvent, QPainter
from PySide6.QtWidgets import QLabel, QLineEdit, QSizePolicy, QWidget

from degense.widgets import forms
from degense.widgets.keys import TYPING, keep_keys

_OPENING = frozenset({Qt.Key.Key_F2, Qt.Key.Key_Return, Qt.Key.Key_Enter})


class _Editor(QLineEdit):
    """Escape leaves the old words; Enter and going elsewhere take the new ones."""

    left = Signal(bool)  # (taken)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key.Key_Escape:
            self.left.emit(False)
        elif event.key() in _OPENING:
            self.left.emit(True)
        else:
            super().keyPressEvent(event)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        super().focusOutEvent(event)
        if event.reason() != Qt.FocusReason.PopupFocusReason:
            self.left.emit(True)


class PromptName(forms.Painted, QLabel):
    """Plain text that is elided where there is no room. A double click, F2 or Enter opens it to be written."""

    renamed = Signal(str)

    def __init__(self, text: str, parent: QWidget) -> None:
        super().__init__(text, parent)
        self.words = text  # what is written, without the “not” before a negative
        self._editor: _Editor | None = None
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        forms.named(self, f"Prompt {text}", f"{text}\nDouble click or F2: other words")
        keep_keys(self, _OPENING)

    def edit(self) -> None:
        """Show a field in place of the words."""
        if self._editor is None:
            self._editor = editor = forms.named(_Editor(self.words, self.parentWidget(), maxLength=200), f"Other words for {self.words}")
            keep_keys(editor, TYPING)
            keep_keys(editor, {Qt.Key.Key_Escape})
            editor.left.connect(self._close)
            editor.setGeometry(self.geometry().adjusted(-4, -2, 0, 2))
            editor.show()
            editor.selectAll()
            editor.setFocus()

    def _close(self, taken: bool) -> None:
        editor, self._editor = self._editor, None
        if editor is None:
            return
        words = " ".join(editor.text().split())
        if editor.hasFocus():
            self.setFocus()
        editor.hide()
        editor.deleteLater()
        if taken and words and words != self.words:
            self.renamed.emit(words)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in _OPENING:
            self.edit()
        else:
            super().keyPressEvent(event)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        self.edit()

    def focusInEvent(self, event: QFocusEvent) -> None:
        super().focusInEvent(event)
        self.update()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        super().focusOutEvent(event)
        self.update()

    def _paint(self, painter: QPainter) -> None:
        text = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideRight, self.width())
        alignment = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
        self.style().drawItemText(painter, self.rect(), alignment, self.palette(), self.isEnabled(), text, self.foregroundRole())
        if self.hasFocus():
            painter.setPen(self.palette().color(self.palette().ColorRole.Accent))
            painter.drawRect(self.rect().adjusted(0, 0, -1, -1))
