"""What the left button does in a picture, when it does not look around: tools that draw, and the outlines of regions."""

from __future__ import annotations

from typing import Protocol

from PySide6.QtCore import QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPen, QPolygonF

#: An outline with fewer than this many pixels across is a slip of the hand.
SMALLEST = 2.0


class PanelTool(Protocol):
    """A tool in the hand. Points are pixels of the full-size image (corner-based, so a pixel's middle lies at .5), and may lie outside it.

    While a tool is in the hand the left button is its own; the right and middle ones pan, the wheel zooms.
    """

    cursor: Qt.CursorShape

    def press(self, point: QPointF, event: QMouseEvent) -> None: ...

    def move(self, point: QPointF, event: QMouseEvent) -> None:
        """Also without a button down."""

    def release(self, point: QPointF, event: QMouseEvent) -> None: ...

    def paint(self, painter: QPainter, scale: float) -> None:
        """Paint over the picture. The painter works in image pixels; `scale` is how many screen pixels one takes."""


def paint_outline(painter: QPainter, outline: QPolygonF, scale: float, closed: bool = True) -> None:
    """A line that is seen on any tissue: white on black."""
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for colour, width in ((QColor(0, 0, 0, 180), 3.0), (QColor(255, 255, 255), 1.4)):
        painter.setPen(QPen(colour, width / scale, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin))
        painter.drawPolygon(outline) if closed else painter.drawPolyline(outline)


class RegionTool(QObject):
    """Draw a rectangle, or freely (`lasso`), with the left button held down.

    Signals
    -------
    drawn(outline)
        A list of (x, y), pixels, of at least three corners.
    """

    drawn = Signal(list)
    cursor = Qt.CursorShape.CrossCursor

    def __init__(self, lasso: bool, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.lasso = lasso
        self._points: list[QPointF] = []

    def press(self, point: QPointF, event: QMouseEvent) -> None:
        self._points = [point]

    def move(self, point: QPointF, event: QMouseEvent) -> None:
        if self._points:
            self._points = [*self._points, point] if self.lasso else [self._points[0], point]

    def release(self, point: QPointF, event: QMouseEvent) -> None:
        self.move(point, event)
        outline, self._points = self._outline(), []
        box = outline.boundingRect()
        if min(box.width(), box.height()) >= SMALLEST:
            self.drawn.emit([(corner.x(), corner.y()) for corner in outline.toList()])

    def paint(self, painter: QPainter, scale: float) -> None:
        if len(self._points) > 1:
            paint_outline(painter, self._outline(), scale)

    def _outline(self) -> QPolygonF:
        if self.lasso or len(self._points) < 2:
            return QPolygonF(self._points)
        box = QRectF(self._points[0], self._points[-1]).normalized()
        return QPolygonF([box.topLeft(), box.topRight(), box.bottomRight(), box.bottomLeft()])
