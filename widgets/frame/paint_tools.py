"""Tools that paint label maps: they report positions and change nothing themselves."""

from __future__ import annotations

from PySide6.QtCore import QObject, QPointF, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPen, QPolygonF

from degense.widgets.frame.panel_marks import paint_outline
from degense.widgets.frame.panel_tools import PanelTool

#: How near a click must come to the first corner to close a polygon; screen pixels.
CLOSING = 10.0


class StrokeTool(PanelTool):
    """A round brush with the left button held down."""

    began = Signal(float, float)  # (x, y) in pixels of the image
    moved = Signal(float, float, float, float)  # (from x, from y, to x, to y)
    ended = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.radius = 8.0
        self._at: QPointF | None = None
        self._down = False

    def press(self, point: QPointF, event: QMouseEvent) -> None:
        self._at, self._down = point, True
        self.began.emit(point.x(), point.y())

    def move(self, point: QPointF, event: QMouseEvent) -> None:
        before, self._at = self._at, point
        if self._down and before is not None:
            self.moved.emit(before.x(), before.y(), point.x(), point.y())

    def release(self, point: QPointF, event: QMouseEvent) -> None:
        self.move(point, event)
        self._down = False
        self.ended.emit()

    def paint(self, painter: QPainter, scale: float) -> None:
        if self._at is None:
            return
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for colour, width in ((QColor(0, 0, 0, 180), 3.0), (QColor(255, 255, 255), 1.4)):
            painter.setPen(QPen(colour, width / scale))
            painter.drawEllipse(self._at, self.radius, self.radius)


class ClickTool(PanelTool):
    """A single click."""

    clicked = Signal(float, float)  # (x, y)
    cursor = Qt.CursorShape.PointingHandCursor

    def press(self, point: QPointF, event: QMouseEvent) -> None:
        self.clicked.emit(point.x(), point.y())


class PolygonTool(PanelTool):
    """Clicks set corners; a double click, or a click on the first corner, closes."""

    drawn = Signal(list)  # (corners) a list of (x, y), at least three

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._corners: list[QPointF] = []
        self._at = QPointF()
        self._scale = 1.0

    @property
    def corners(self) -> int:
        """How many are set."""
        return len(self._corners)

    def press(self, point: QPointF, event: QMouseEvent) -> None:
        self._at = point
        if len(self._corners) >= 3 and any(self._near(point, corner) for corner in (self._corners[0], self._corners[-1])):
            self.close()
        elif not self._corners or not self._near(point, self._corners[-1]):
            self._corners.append(point)

    def move(self, point: QPointF, event: QMouseEvent) -> None:
        self._at = point

    def close(self) -> None:
        """Finish the outline, if it encloses something."""
        corners, self._corners = self._corners, []
        if len(corners) >= 3:
            self.drawn.emit([(corner.x(), corner.y()) for corner in corners])

    def remove_last(self) -> None:
        """Take the last corner back."""
        del self._corners[-1:]

    def cancel(self) -> None:
        self._corners = []

    def paint(self, painter: QPainter, scale: float) -> None:
        self._scale = scale
        if self._corners:
            paint_outline(painter, QPolygonF([*self._corners, self._at]), scale, closed=False)
            painter.setBrush(QColor(255, 255, 255))
            painter.setPen(QPen(QColor(0, 0, 0, 180), 1.0 / scale))
            for corner in self._corners:
                painter.drawEllipse(corner, 3.0 / scale, 3.0 / scale)

    def _near(self, one: QPointF, other: QPointF) -> bool:
        return (one - other).manhattanLength() * self._scale <= CLOSING
