"""Histogram of the similarities of the pixels to each prompt, with the threshold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPalette, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from degense.widgets.forms import PaintedWidget
from degense.widgets.theme import faded


class SimilarityHistogram(PaintedWidget):
    """One curve a prompt over the similarity from 0 to 1, and the threshold as a line that can be dragged.

    Heights are square roots of shares: most pixels lie outside the mask, and would dwarf those inside.

    Signals
    -------
    threshold_dragged(threshold)
    """

    threshold_dragged = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Histogram of the similarities")
        self.setToolTip("How many pixels are how similar to each prompt; drag the line to move the threshold")
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setCursor(Qt.CursorShape.SplitHCursor)
        self._curves: list[tuple[np.ndarray, QColor]] = []
        self._threshold = 0.5

    def set_curves(self, curves: Sequence[tuple[np.ndarray, QColor]]) -> None:
        """Show counts [bins] over equal steps from 0 to 1, each in its colour."""
        self._curves = [(np.sqrt(counts / max(float(counts.sum()), 1.0)), QColor(colour)) for counts, colour in curves]
        self.setVisible(bool(self._curves))
        self.update()

    def set_threshold(self, threshold: float) -> None:
        self._threshold = threshold
        self.update()

    def count(self) -> int:
        return len(self._curves)

    def sizeHint(self) -> QSize:
        return QSize(200, 52)

    def _area(self) -> QRectF:
        return QRectF(self.rect()).adjusted(4, 3, -4, -3)

    def _paint(self, painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), self.palette().color(QPalette.ColorRole.AlternateBase))
        area = self._area()
        tallest = max((float(heights.max()) for heights, _ in self._curves), default=0.0) or 1.0
        for heights, colour in self._curves:
            middles = (np.arange(len(heights)) + 0.5) / len(heights)
            line = [
                QPointF(area.left() + x * area.width(), area.bottom() - h / tallest * area.height())
                for x, h in zip(middles, heights, strict=True)
            ]
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(faded(colour, 60))
            painter.drawPolygon(QPolygonF([QPointF(line[0].x(), area.bottom()), *line, QPointF(line[-1].x(), area.bottom())]))
            painter.setPen(QPen(colour, 1.4))
            painter.drawPolyline(QPolygonF(line))
        x = area.left() + min(max(self._threshold, 0.0), 1.0) * area.width()
        painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Accent), 1.6))
        painter.drawLine(QPointF(x, self.rect().top()), QPointF(x, self.rect().bottom()))

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self._drag(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if event.buttons() & Qt.MouseButton.LeftButton:
            self._drag(event)

    def _drag(self, event: QMouseEvent) -> None:
        area = self._area()
        self.set_threshold(min(max((event.position().x() - area.left()) / area.width(), 0.0), 1.0))
        self.threshold_dragged.emit(self._threshold)
