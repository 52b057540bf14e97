"""Measures in the 2D view: how they are painted, and the tool that sets their corners."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QFontMetricsF, QKeyEvent, QMouseEvent, QPainter, QPen, QPolygonF

from degense.app.features.measure.state import CORNERS, Kind
from degense.widgets.frame.paint_tools import CLOSING
from degense.widgets.frame.panel_tools import PanelTool
from degense.widgets.theme import faded

#: Where a pixel position of the frame is painted.
Place = Callable[[QPointF], QPointF]
DARK = QColor(0, 0, 0, 180)
END = 3.5  # radius of a corner, screen pixels
HINTS: dict[Kind, str] = {
    "distance": "Click both ends of the distance",
    "path": "Click along the path; a double click or Enter ends it, Backspace takes the last corner back, Escape all",
    "area": "Click around the area; a double click or Enter closes it, Backspace takes the last corner back, Escape all",
}


class MeasureTool(PanelTool):
    """Clicks set the corners of one kind of measure."""

    drawn = Signal(str, list)  # (kind, corners as (x, y))

    def __init__(self, kind: Kind, parent: QObject) -> None:
        super().__init__(parent)
        self.kind, self.hint = kind, HINTS[kind]
        self.corners: list[QPointF] = []
        self._at, self._scale, self._closing = QPointF(), 1.0, False

    def press(self, point: QPointF, event: QMouseEvent) -> None:
        self._at = point
        again = bool(self.corners) and (point - self.corners[-1]).manhattanLength() * self._scale <= CLOSING
        if not again:
            self.corners.append(point)
        self._closing = again or len(self.corners) == CORNERS[self.kind][1]

    def release(self, point: QPointF, event: QMouseEvent) -> None:
        self.move(point, event)
        if self._closing:  # not before: without a tool the panel takes the release for a click
            self._closing = False
            self.close()

    def move(self, point: QPointF, event: QMouseEvent) -> None:
        self._at = point

    def close(self) -> None:
        """Finish the measure, if it has enough corners."""
        if len(self.corners) >= CORNERS[self.kind][0]:
            corners, self.corners = self.corners, []
            self.drawn.emit(self.kind, [(corner.x(), corner.y()) for corner in corners])

    def key(self, key: int) -> bool:
        """Answer a key while corners are set; whether it was for the tool."""
        if not self.corners or key not in (Qt.Key.Key_Return, Qt.Key.Key_Enter, Qt.Key.Key_Backspace, Qt.Key.Key_Escape):
            return False
        if key == Qt.Key.Key_Backspace:
            self.corners.pop()
        elif key == Qt.Key.Key_Escape:
            self.corners = []
        else:
            self.close()
        return True

    def paint(self, painter: QPainter, scale: float) -> None:
        self._scale = scale
        if self.corners:
            paint_line(painter, [*self.corners, self._at], QColor(255, 255, 255), 1 / scale)


class ToolKeys(QObject):
    """Hands Enter, Backspace and Escape to the tool of a panel while it has corners, before the window's shortcuts get them."""

    def __init__(self, parent: QObject, panel: QObject, tools: Sequence[MeasureTool]) -> None:
        super().__init__(parent)
        self._tools = tools
        for watched in (parent, panel):
            watched.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        tool = next((tool for tool in self._tools if tool.corners), None)
        if tool is None or not isinstance(event, QKeyEvent) or event.modifiers() != Qt.KeyboardModifier.NoModifier:
            return False
        if event.type() == QEvent.Type.ShortcutOverride:
            if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter, Qt.Key.Key_Backspace, Qt.Key.Key_Escape):
                event.accept()
                return True
            return False
        return event.type() == QEvent.Type.KeyPress and tool.key(event.key())


def paint_line(painter: QPainter, corners: Sequence[QPointF], colour: QColor, size: float, closed: bool = False) -> None:
    """A line with its corners, legible on any ground; `size` is a screen pixel in the painter's units."""
    line = QPolygonF([*corners, corners[0]] if closed else list(corners))
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for ink, width in ((DARK, 4.0), (colour, 2.0)):
        painter.setPen(QPen(ink, width * size))
        painter.drawPolyline(line)
    painter.setBrush(colour)
    painter.setPen(QPen(DARK, size))
    for corner in corners:
        painter.drawEllipse(corner, END * size, END * size)
    painter.setBrush(Qt.BrushStyle.NoBrush)


def paint_measure(painter: QPainter, place: Place, corners: np.ndarray, colour: QColor, closed: bool) -> None:
    """A measure; corners float [K, 2], pixels of the frame."""
    ends = _ends(place, corners)
    if closed and ends:
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(faded(colour, 50))
        painter.drawPolygon(QPolygonF(ends))
    if ends:
        paint_line(painter, ends, colour, 1.0, closed)


def paint_value(painter: QPainter, place: Place, corners: np.ndarray, text: str, closed: bool) -> None:
    """The value of a measure, beside its line or in the middle of its area."""
    ends = _ends(place, corners)
    if not ends:
        return
    middle = sum(ends, QPointF()) / len(ends)
    size = QFontMetricsF(painter.font())
    box = QRectF(0, 0, size.horizontalAdvance(text) + 10, size.height() + 4)
    box.moveCenter(middle if closed else (ends[0] + ends[-1]) / 2 + QPointF(0, -box.height()))
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(DARK)
    painter.drawRoundedRect(box, 3, 3)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.setPen(QColor(255, 255, 255))
    painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)


def _ends(place: Place, corners: np.ndarray) -> list[QPointF]:
    """The corners that are known, where they are painted."""
    return [place(QPointF(*corner)) for corner in corners if np.isfinite(corner).all()]
