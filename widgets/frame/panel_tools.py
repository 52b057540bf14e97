"""Tools for the left mouse button in a frame; the one that draws the outline of a region."""

from __future__ import annotations

from PySide6.QtCore import QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QMouseEvent, QPainter, QPolygonF

from degense.widgets.frame.panel_marks import paint_outline

#: An outline with fewer than this many pixels across was not meant.
SMALLEST = 2.0


class PanelTool(QObject):
    """An active tool; this one does nothing.

    Points are pixels of the image (corner-based, so a pixel's middle lies at .5), and may lie outside it.

    While a tool is active the left button is its own; the right and middle ones pan, the wheel zooms.
    """

    cursor = Qt.CursorShape.CrossCursor
    hint = ""  # what the left button does

    def press(self, point: QPointF, event: QMouseEvent) -> None:
        """The left button goes down."""

    def move(self, point: QPointF, event: QMouseEvent) -> None:
        """Also without a button down."""

    def release(self, point: QPointF, event: QMouseEvent) -> None:
        """As a move, unless a tool does more."""
        self.move(point, event)

    def paint(self, painter: QPainter, scale: float) -> None:
        """Paint over the frame. The painter works in image pixels; `scale` is how many screen pixels one takes."""


class RegionTool(PanelTool):
    """Draw a rectangle, or freely (`lasso`), with the left button held down."""

    hint = "Drag: draw around what is to be followed"

    drawn = Signal(list)  # (outline) a list of (x, y), pixels, of at least three corners

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
