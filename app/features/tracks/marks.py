"""Points in the 2D view: how they are painted, and the tool that adds and drags them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QLineF, QObject, QPointF, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPen

from degense.widgets.frame.panel_marks import paint_tag
from degense.widgets.frame.panel_tools import PanelTool
from degense.widgets.frame.panel_zoom import PanelZoom
from degense.widgets.theme import faded

DARK, WHITE = QColor(0, 0, 0, 180), QColor(255, 255, 255)
RADIUS, CROSS = 4.5, 5.0  # screen pixels
GRIP, SLACK = 10.0, 3.0  # how near a mark is taken hold of, and how far a press may move and still be a click; screen pixels


class Mark(NamedTuple):
    """A point in a frame."""

    number: int
    colour: QColor
    trail: np.ndarray  # [n, 2], pixels; ends where the point is
    visible: bool


def paint_mark(painter: QPainter, zoom: PanelZoom, mark: Mark, chosen: bool) -> None:
    """A disc with its number, a ring where the point is hidden, with a ring around it when it is chosen; its trail fades."""
    ends = [zoom.to_widget(QPointF(*place)) for place in mark.trail]
    for step, (start, end) in enumerate(pairwise(ends), 1):
        painter.setPen(QPen(faded(mark.colour, 255 * step // len(ends)), 2.0))
        painter.drawLine(start, end)
    for colour, width in ((DARK, 4.0), (mark.colour, 2.0)):
        painter.setPen(QPen(colour, width))
        painter.drawEllipse(ends[-1], RADIUS, RADIUS)
        if chosen:
            painter.drawEllipse(ends[-1], 2 * RADIUS, 2 * RADIUS)
    if mark.visible:
        painter.setBrush(mark.colour)
        painter.drawEllipse(ends[-1], RADIUS, RADIUS)
        painter.setBrush(Qt.BrushStyle.NoBrush)
    paint_tag(painter, ends[-1] + QPointF(2 * RADIUS, -painter.fontMetrics().height() - RADIUS), str(mark.number))


def paint_known(painter: QPainter, zoom: PanelZoom, known: np.ndarray, found: np.ndarray) -> None:
    """Crosses where points [K, 2] are said to be, each with a line to where it was followed to."""
    for place, other in zip(known, found, strict=True):
        at = zoom.to_widget(QPointF(*place))
        lines = [QLineF(at - QPointF(CROSS, way * CROSS), at + QPointF(CROSS, way * CROSS)) for way in (-1, 1)]
        if np.isfinite(other).all():
            lines.append(QLineF(at, zoom.to_widget(QPointF(*other))))
        for colour, width in ((DARK, 3.2), (WHITE, 1.4)):
            painter.setPen(QPen(colour, width))
            painter.drawLines(lines)


class PointTool(PanelTool):
    """A click adds a point or chooses the one there; dragging a mark corrects it. `marks` gives those of the frame that is shown."""

    hint = "Click: follow this point · drag its mark: correct it"
    placed = Signal(object, float, float)  # (number of the point, None for a new one; x, y in pixels)
    chosen = Signal(int)  # (number)

    def __init__(self, zoom: PanelZoom, marks: Callable[[], Sequence[Mark]], parent: QObject) -> None:
        super().__init__(parent)
        self._zoom, self._marks = zoom, marks
        self._held: Mark | None = None
        self._from, self._at = QPointF(), QPointF()

    def press(self, point: QPointF, event: QMouseEvent) -> None:
        self._from = self._at = point
        marks = self._marks()
        apart = [(float(np.hypot(*(mark.trail[-1] - (point.x(), point.y())))), k) for k, mark in enumerate(marks)]
        distance, nearest = min(apart, default=(np.inf, 0))
        self._held = marks[nearest] if distance * self._zoom.scale < GRIP else None

    def move(self, point: QPointF, event: QMouseEvent) -> None:
        self._at = point

    def release(self, point: QPointF, event: QMouseEvent) -> None:
        held, self._held = self._held, None
        if held is not None and QLineF(self._from, point).length() * self._zoom.scale <= SLACK:
            self.chosen.emit(held.number)
        elif 0 <= point.x() < self._zoom.image[0] and 0 <= point.y() < self._zoom.image[1]:
            self.placed.emit(held and held.number, point.x(), point.y())

    def paint(self, painter: QPainter, scale: float) -> None:
        if self._held is not None:
            painter.setPen(QPen(self._held.colour, 2.0 / scale))
            painter.drawLine(QPointF(*self._held.trail[-1]), self._at)
            painter.drawEllipse(self._at, RADIUS / scale, RADIUS / scale)
