"""A small line plot: several named curves over frames or iterations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from degense.widgets import forms
from degense.widgets.curve_scale import LARGEST, Scale
from degense.widgets.numbers import short
from degense.widgets.theme import class_colour, faded

#: Width of a curve, diameter of a point that stands alone, free pixels around all; opacity of a band and of the grid, of 255.
LINE, POINT, EDGE, BAND, GRID = 1.6, 3.2, 4, 45, 90
#: Height from which the axis below says what it counts.
WITH_LABEL = 130
#: The plot is wider than this many points a pixel are: then the least and the largest of each pixel are drawn.
DENSE = 4


@dataclass(frozen=True)
class Curve:
    """A curve with x ascending; y is NaN in gaps."""

    x: np.ndarray
    y: np.ndarray
    colour: QColor
    band: tuple[np.ndarray, np.ndarray] | None


class CurvePlot(forms.PaintedWidget):
    """Curves with a legend, a cursor line and a read-out under the pointer.

    Values that are not finite leave gaps; with a logarithmic axis (`log`) also those that are not positive.
    """

    x_clicked = Signal(float)

    def __init__(self, parent: QWidget | None = None, log: bool = False) -> None:
        super().__init__(parent)
        self.setAccessibleName("Plot")
        self.setMouseTracking(True)
        self.setAutoFillBackground(True)
        self.setBackgroundRole(self.palette().ColorRole.AlternateBase)
        self._log, self._bare = log, False
        self.series: dict[str, Curve] = {}
        self._labels = "frame", ""
        self._message = "Nothing to plot yet"
        self._cursor: float | None = None
        self._pointer: float | None = None

    def set_series(
        self,
        name: str,
        x: np.ndarray,
        y: np.ndarray,
        colour: QColor | None = None,
        band: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> None:
        """Add or replace a curve, x ascending. A band (low, high), as long as the curve, is shaded behind it."""
        if len(x) != len(y):
            raise ValueError(f"the curve {name!r} has {len(x)} positions and {len(y)} values")
        old = self.series.pop(name, None)
        colour = colour or (old.colour if old is not None else class_colour(len(self.series)))
        known = (np.abs(y) < LARGEST) & (np.asarray(y) > (0.0 if self._log else -LARGEST))
        self.series[name] = Curve(np.asarray(x, float), np.where(known, y, np.nan), QColor(colour), band)
        self.update()

    def append(self, name: str, x: float, y: float) -> None:
        """Add one point to a curve, which is made when it does not exist."""
        xs, ys = self.points(name) if name in self.series else (np.zeros(0), np.zeros(0))
        self.set_series(name, np.append(xs, x), np.append(ys, y))

    def points(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Positions and values of a curve."""
        return self.series[name].x, self.series[name].y

    def remove(self, name: str) -> None:
        """Take a curve away; KeyError when there is none of that name."""
        del self.series[name]
        self.update()

    def clear(self) -> None:
        """Take all curves away, and the cursor."""
        self.series.clear()
        self._pointer = None
        self.set_cursor(None)

    def set_cursor(self, x: float | None) -> None:
        self._cursor = x
        self.update()

    def set_labels(self, x: str = "frame", y: str = "") -> None:
        self._labels = x, y
        self.update()

    def hide_axes(self) -> None:
        """Show nothing but the curves, from 0 to 1."""
        self._bare = True

    def set_message(self, text: str) -> None:
        """What to say when there is no curve."""
        self._message = text
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(320, 180)

    def minimumSizeHint(self) -> QSize:
        return QSize(140, 90)

    # Where things lie

    def is_empty(self) -> bool:
        """Whether no curve has a point."""
        return not any(np.isfinite(curve.y).any() for curve in self.series.values())

    def _scales(self) -> tuple[Scale, Scale]:
        """Along the axis below, and up the one at the left."""
        line, right = self.fontMetrics().height(), self.width() - 2 * EDGE
        if self._bare:
            return Scale(0.0, 1.0, EDGE, self.width() - EDGE), self._upwards(self.height() - EDGE, EDGE)
        below = 2 * line if self.height() > WITH_LABEL else line
        upwards = self._upwards(self.height() - below - EDGE, line + 2 * EDGE)
        left = max((self.fontMetrics().horizontalAdvance(short(value)) for value in upwards.ticks(2 * line)), default=0) + 2 * EDGE
        return Scale.of((curve.x for curve in self.series.values()), left, right), upwards

    def _upwards(self, bottom: float, top: float) -> Scale:
        bands = [edge for curve in self.series.values() if curve.band is not None for edge in curve.band]
        return Scale.of([*(curve.y for curve in self.series.values()), *bands], bottom, top, self._log)

    # Painting

    def _paint(self, painter: QPainter) -> None:
        if self.is_empty():
            painter.setPen(self.palette().placeholderText().color())
            flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap.value
            painter.drawText(self.rect().adjusted(12, 12, -12, -12), flags, self._message)
            return
        along, upwards = self._scales()
        if not self._bare:
            self._paint_axes(painter, along, upwards)
            self._paint_legend(painter)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for curve in self.series.values():
            _paint_curve(painter, curve, along, upwards)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        lines = ((self._cursor, QPen(self.palette().accent().color(), LINE)), (self._pointer, QPen(Qt.PenStyle.DotLine)))
        for x, pen in lines:
            if x is not None:
                painter.setPen(pen)
                at = float(along.pixels(np.array(x)))
                painter.drawLine(QPointF(at, upwards.first), QPointF(at, upwards.last))

    def _paint_axes(self, painter: QPainter, along: Scale, upwards: Scale) -> None:
        """Ticks with their numbers, a faint grid, and what is counted below."""
        colours, line = self.palette(), painter.fontMetrics().height()
        text, grid = colours.placeholderText().color(), faded(colours.mid().color(), GRID)
        for value in upwards.ticks(2 * line):
            y = float(upwards.pixels(np.array(value)))
            painter.setPen(grid)
            painter.drawLine(QPointF(along.first, y), QPointF(along.last, y))
            painter.setPen(text)
            painter.drawText(QRectF(0, y - line / 2, along.first - EDGE, line), Qt.AlignmentFlag.AlignRight, short(value))
        widest = painter.fontMetrics().horizontalAdvance(f"{short(along.high, 5)}  ")
        for value in along.ticks(1.5 * widest):
            x = float(along.pixels(np.array(value)))
            painter.setPen(grid)
            painter.drawLine(QPointF(x, upwards.first), QPointF(x, upwards.last))
            painter.setPen(text)
            painter.drawText(QRectF(x - widest, upwards.first + 1, 2 * widest, line), Qt.AlignmentFlag.AlignHCenter, short(value, 6))
        if self.height() > WITH_LABEL:
            below = QRectF(along.first, upwards.first + line, along.last - along.first, line)
            painter.drawText(below, Qt.AlignmentFlag.AlignHCenter, self._labels[0])

    def _paint_legend(self, painter: QPainter) -> None:
        """Names in a row on top; under the pointer, with the values there."""
        metrics, x = painter.fontMetrics(), 2.0 * EDGE
        for text, colour in self._legend():
            room = self.width() - EDGE - x
            painter.setPen(colour)
            painter.drawText(QPointF(x, EDGE + metrics.ascent()), metrics.elidedText(text, Qt.TextElideMode.ElideRight, int(max(0, room))))
            x += metrics.horizontalAdvance(text)

    def _legend(self) -> Iterator[tuple[str, QColor]]:
        """Its pieces from the left, each with its colour."""
        colours, at = self.palette(), self._pointer
        lead = self._labels[1] if at is None else f"{self._labels[0]} {short(at, 6)}"
        yield f"{lead}   " if lead else "", colours.placeholderText().color()
        for name, curve in self.series.items():
            near = "" if at is None or not len(curve.x) else f" {short(curve.y[np.argmin(np.abs(curve.x - at))], 4)}"
            yield "— ", curve.colour
            yield f"{name}{near}   ", colours.text().color()

    # Events

    def x_at(self, event: QMouseEvent) -> float:
        """The position on the x axis under the pointer."""
        return self._scales()[0].value(event.position().x())

    def _point(self, event: QMouseEvent) -> None:
        """Show the values at the point of a curve that is nearest to the pointer; with the left button down it is clicked."""
        if self.is_empty():
            return
        x = np.concatenate([curve.x for curve in self.series.values()])
        self._pointer = float(x[np.argmin(np.abs(x - self.x_at(event)))])
        self.update()
        if event.buttons() & Qt.MouseButton.LeftButton:
            self.x_clicked.emit(self._pointer)

    mousePressEvent = mouseMoveEvent = _point

    def leaveEvent(self, event: QEvent) -> None:
        self._pointer = None
        self.update()


def _paint_curve(painter: QPainter, curve: Curve, along: Scale, upwards: Scale) -> None:
    """The band, the line with its gaps, and points that stand alone."""
    x, y = along.pixels(curve.x), upwards.pixels(curve.y)
    if curve.band is not None:
        low, high = (np.where(np.isfinite(y), upwards.pixels(edge), np.nan) for edge in curve.band)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(faded(curve.colour, BAND))
        for start, end in _runs(np.isfinite(low + high)):
            edge = np.concatenate([x[start:end], x[start:end][::-1]]), np.concatenate([low[start:end], high[start:end][::-1]])
            painter.drawPolygon(_polygon(*edge))
    x, y = _thinned(x, y)
    for start, end in _runs(np.isfinite(y)):
        if end - start == 1:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(curve.colour)
            painter.drawEllipse(QPointF(x[start], y[start]), POINT / 2, POINT / 2)
        else:
            painter.setPen(QPen(curve.colour, LINE))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawPolyline(_polygon(x[start:end], y[start:end]))


def _thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest of each pixel, where far more points than pixels lie between the first and the last."""
    if len(x) < 2 or len(x) < DENSE * (x[-1] - x[0]):
        return x, y
    starts = np.flatnonzero(np.diff(np.floor(x), prepend=np.nan) != 0)
    return np.repeat(x[starts], 2), np.column_stack([np.fmin.reduceat(y, starts), np.fmax.reduceat(y, starts)]).ravel()


def _runs(known: np.ndarray) -> Iterator[tuple[int, int]]:
    """Where runs of what is known begin and end."""
    steps = np.diff(known.astype(np.int8), prepend=0, append=0)
    return zip(np.flatnonzero(steps == 1).tolist(), np.flatnonzero(steps == -1).tolist(), strict=True)


def _polygon(x: np.ndarray, y: np.ndarray) -> QPolygonF:
    return QPolygonF([QPointF(*point) for point in zip(x.tolist(), y.tolist(), strict=True)])
