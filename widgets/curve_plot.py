"""A small line plot: several named curves over frames or iterations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPalette, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from degense.widgets.forms import PaintedWidget
from degense.widgets.theme import class_colour, faded
from degense.widgets.ticks import linear_ticks, log_ticks, pieces, short

#: Larger values (and, on a logarithmic axis, smaller ones than its inverse) are gaps: the axis could not be computed.
LARGEST = 1e100


@dataclass
class _Series:
    colour: QColor
    x: list[float]
    y: list[float]
    band: tuple[np.ndarray, np.ndarray] | None = None


class CurvePlot(PaintedWidget):
    """Curves with round ticks, a legend, a cursor line and a read-out under the pointer. Values that are not finite leave gaps."""

    x_clicked = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Plot")
        self.setMouseTracking(True)
        self.setMinimumSize(140, 90)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self._series: dict[str, _Series] = {}
        self._cursor: float | None = None
        self._log = False
        self._x_label, self._y_label = "frame", ""
        self._message = "Nothing to plot yet"
        self._pointer: float | None = None  # widget x of the pointer
        self._pressed = False

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
        if colour is None:
            colour = self._series[name].colour if name in self._series else class_colour(len(self._series))
        self._series[name] = _Series(colour, [float(v) for v in x], [float(v) for v in y], band)
        self.update()

    def append(self, name: str, x: float, y: float) -> None:
        """Add one point to a curve, which is made when it does not exist."""
        if name not in self._series:
            self.set_series(name, np.zeros(0), np.zeros(0))
        self._series[name].x.append(float(x))
        self._series[name].y.append(float(y))
        self.update()

    def clear(self) -> None:
        self._series.clear()
        self.update()

    def series_names(self) -> list[str]:
        return list(self._series)

    def set_cursor(self, x: float | None) -> None:
        self._cursor = x
        self.update()

    def set_log_y(self, on: bool) -> None:
        """Logarithmic values; those that are not positive leave gaps."""
        self._log = on
        self.update()

    def set_labels(self, x: str = "frame", y: str = "") -> None:
        self._x_label, self._y_label = x, y
        self.update()

    def set_message(self, text: str) -> None:
        """What to say when there is no curve."""
        self._message = text
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(320, 180)

    # Geometry

    def _values(self, series: _Series) -> np.ndarray:
        """What is plotted of the values; NaN, a gap, where a value is not finite, absurd, or not positive on a logarithmic axis."""
        y = np.asarray(series.y, float)
        y = np.where(np.abs(y) < LARGEST, y, np.nan)
        return np.log10(y, where=y > 1 / LARGEST, out=np.full(len(y), np.nan)) if self._log else y

    def _limits(self) -> tuple[float, float, float, float] | None:
        """(x low, x high, y low, y high) of the finite points, y in plotted units, or None without any."""
        xs = [np.asarray(s.x) for s in self._series.values() if s.x]
        ys = [self._values(s) for s in self._series.values() if s.y]
        ys += [edge for s in self._series.values() if s.band is not None and not self._log for edge in s.band]
        if not xs:
            return None
        y = np.concatenate(ys)
        y = y[np.isfinite(y)]
        if not len(y):
            return None
        x = np.concatenate(xs)
        x0, x1, y0, y1 = float(x.min()), float(x.max()), float(y.min()), float(y.max())
        if x1 == x0:
            x0, x1 = x0 - 0.5, x1 + 0.5
        pad = 0.06 * (y1 - y0) or 0.1 * abs(y1) or 0.5
        return x0, x1, (0.0 if not self._log and y0 >= 0 and y0 - pad < 0 else y0 - pad), y1 + pad

    def _layout(self) -> tuple[QRectF, tuple[float, float, float, float], list[tuple[float, str]]] | None:
        """The plotting rectangle, its limits, and the y ticks as (plotted value, text)."""
        limits = self._limits()
        if limits is None:
            return None
        metrics = self.fontMetrics()
        legend = metrics.height() + 6
        bottom = metrics.height() + 6 + (metrics.height() if self._x_label and self.height() > 130 else 0)
        count = max(2, int((self.height() - legend - bottom) / (2.2 * metrics.height())))
        if self._log:
            ticks = [(math.log10(v), short(v, 2)) for v in log_ticks(10 ** limits[2], 10 ** limits[3], count)]
        else:
            ticks = [(v, short(v, 4)) for v in linear_ticks(limits[2], limits[3], count)]
        left = max([metrics.horizontalAdvance(text) for _, text in ticks], default=20) + 10
        return QRectF(left, legend, max(self.width() - left - 10, 10), max(self.height() - legend - bottom, 10)), limits, ticks

    # Painting

    def _paint(self, painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), self.palette().color(QPalette.ColorRole.AlternateBase))
        quiet = self.palette().color(QPalette.ColorRole.PlaceholderText)
        layout = self._layout()
        if layout is None:
            painter.setPen(quiet)
            painter.drawText(
                self.rect().adjusted(12, 12, -12, -12), Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap.value, self._message
            )
            return
        area, limits, y_ticks = layout
        self._paint_axes(painter, area, limits, y_ticks, quiet)
        painter.save()
        painter.setClipRect(area.adjusted(-1, -1, 1, 1))
        for series in self._series.values():
            self._paint_curve(painter, series, area, limits)
        if self._cursor is not None:
            painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Accent), 1.4))
            x = self._to_x(self._cursor, area, limits)
            painter.drawLine(QPointF(x, area.top()), QPointF(x, area.bottom()))
        painter.restore()
        self._paint_legend(painter, area, limits)

    def _paint_axes(self, painter: QPainter, area: QRectF, limits: tuple, y_ticks: list[tuple[float, str]], quiet: QColor) -> None:
        metrics = painter.fontMetrics()
        grid = faded(self.palette().color(QPalette.ColorRole.Mid), 110)
        for value, text in y_ticks:
            y = self._to_y(value, area, limits)
            painter.setPen(grid)
            painter.drawLine(QPointF(area.left(), y), QPointF(area.right(), y))
            painter.setPen(quiet)
            painter.drawText(QRectF(0, y - 10, area.left() - 5, 20), Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter, text)
        for value in linear_ticks(limits[0], limits[1], max(2, int(area.width() / 45))):
            x = self._to_x(value, area, limits)
            painter.setPen(grid)
            painter.drawLine(QPointF(x, area.top()), QPointF(x, area.bottom()))
            painter.setPen(quiet)
            text = short(value, 6)
            width = metrics.horizontalAdvance(text)
            painter.drawText(QPointF(min(x - width / 2, self.width() - width - 1), area.bottom() + 2 + metrics.ascent()), text)
        if self._x_label and self.height() > 130:
            painter.setPen(quiet)
            label = QRectF(area.left(), self.height() - metrics.height() - 2, area.width(), metrics.height())
            painter.drawText(label, Qt.AlignmentFlag.AlignHCenter, self._x_label)

    def _paint_curve(self, painter: QPainter, series: _Series, area: QRectF, limits: tuple) -> None:
        x, y = np.asarray(series.x), self._values(series)
        # A long run has more points than pixels; one point a half pixel is all that can be seen.
        keep = max(1, len(x) // (2 * max(int(area.width()), 1)))
        if series.band is not None and not self._log:
            self._paint_band(painter, series, area, limits)
        painter.setPen(QPen(series.colour, 1.6, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin))
        for run in pieces(y):
            chosen = run if keep == 1 else np.unique(np.append(run[::keep], run[-1]))
            points = [QPointF(self._to_x(x[i], area, limits), self._to_y(y[i], area, limits)) for i in chosen]
            if len(points) == 1:
                painter.setBrush(series.colour)
                painter.drawEllipse(points[0], 1.6, 1.6)
                painter.setBrush(Qt.BrushStyle.NoBrush)
            else:
                painter.drawPolyline(QPolygonF(points))

    def _paint_band(self, painter: QPainter, series: _Series, area: QRectF, limits: tuple) -> None:
        assert series.band is not None
        low, high = series.band
        for run in pieces(np.asarray(low) + high):
            there = [QPointF(self._to_x(series.x[i], area, limits), self._to_y(high[i], area, limits)) for i in run]
            back = [QPointF(self._to_x(series.x[i], area, limits), self._to_y(low[i], area, limits)) for i in run[::-1]]
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(faded(series.colour, 45))
            painter.drawPolygon(QPolygonF(there + back))
            painter.setBrush(Qt.BrushStyle.NoBrush)

    def _paint_legend(self, painter: QPainter, area: QRectF, limits: tuple) -> None:
        """Names in a row on top; under the pointer, with the values there."""
        metrics = painter.fontMetrics()
        text_colour = self.palette().color(QPalette.ColorRole.Text)
        at = self._pointed_x(area, limits)
        pen = area.left()
        lead = self._y_label if at is None else f"{self._x_label} {short(at, 6)}"
        if lead:
            painter.setPen(self.palette().color(QPalette.ColorRole.PlaceholderText))
            painter.drawText(QPointF(pen, metrics.ascent() + 3), lead)
            pen += metrics.horizontalAdvance(lead) + 12
        if at is not None:
            painter.setPen(QPen(text_colour, 1, Qt.PenStyle.DotLine))
            x = self._to_x(at, area, limits)
            painter.drawLine(QPointF(x, area.top()), QPointF(x, area.bottom()))
        for name, series in self._series.items():
            text = name
            if at is not None and series.x:
                nearest = int(np.argmin(np.abs(np.asarray(series.x) - at)))
                text = f"{name} {short(series.y[nearest], 4)}"
            painter.setPen(QPen(series.colour, 2.4))
            painter.drawLine(QPointF(pen, 3 + metrics.ascent() * 0.65), QPointF(pen + 12, 3 + metrics.ascent() * 0.65))
            painter.setPen(text_colour)
            painter.drawText(QPointF(pen + 16, metrics.ascent() + 3), text)
            pen += 16 + metrics.horizontalAdvance(text) + 12

    def _to_x(self, value: float, area: QRectF, limits: tuple) -> float:
        return area.left() + (value - limits[0]) / (limits[1] - limits[0]) * area.width()

    def _to_y(self, value: float, area: QRectF, limits: tuple) -> float:
        return area.bottom() - (value - limits[2]) / (limits[3] - limits[2]) * area.height()

    def _pointed_x(self, area: QRectF, limits: tuple) -> float | None:
        """The position of a point of a curve nearest to the pointer."""
        if self._pointer is None or not area.left() - 4 <= self._pointer <= area.right() + 4:
            return None
        wanted = limits[0] + (self._pointer - area.left()) / area.width() * (limits[1] - limits[0])
        x = np.concatenate([np.asarray(s.x) for s in self._series.values()])
        return float(x[np.argmin(np.abs(x - wanted))])

    # Events

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self._pointer = event.position().x()
        if self._pressed:
            self._click()
        self.update()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self._pointer = event.position().x()
            self._pressed = True
            self._click()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self._pressed = False

    def leaveEvent(self, event: QEvent) -> None:
        self._pointer = None
        self.update()

    def _click(self) -> None:
        layout = self._layout()
        if layout is not None and (x := self._pointed_x(layout[0], layout[1])) is not None:
            self.x_clicked.emit(x)
