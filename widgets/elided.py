"""Text in one line that ends in dots where there is no room."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter
from PySide6.QtWidgets import QLabel

from degense.widgets import forms


class ElidedLabel(forms.Painted, QLabel):
    """Plain text, never wider than its place, which is at least as wide as `least` characters. The tooltip has all of it."""

    def __init__(self, name: str = "", *, secondary: bool = False, least: int = 0) -> None:
        super().__init__()
        self._least = least
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setObjectName("secondary" if secondary else "")
        self.setAccessibleName(name)

    def setText(self, text: str) -> None:
        super().setText(text)
        self.setToolTip(text)

    def minimumSizeHint(self) -> QSize:
        return QSize(max(1, self._least * self.fontMetrics().averageCharWidth()), super().minimumSizeHint().height())

    def _paint(self, painter: QPainter) -> None:
        text = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideRight, self.width())
        aligned = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
        self.style().drawItemText(painter, self.rect(), aligned, self.palette(), self.isEnabled(), text, self.foregroundRole())
