"""A small line plot: several named curves over frames or iterations."""

from __future__ import annotations

import math
from html import escape

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QSize, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPalette
from PySide6.QtWidgets import QWidget

from degense.widgets.numbers import short
from degense.widgets.theme import class_colour, faded

#: Larger values are gaps: the axis could not be computed.
LARGEST = 1e100


class _Axis(pg.AxisItem):
    """Logarithmic, it has powers of ten, with their doubles and fives where the range is short: pyqtgraph's own labels overlap."""

    def logTickValues(self, low: float, high: float, size: float, linear: object) -> list[tuple[float, list[float]]]:
        factors, stride = (1, 2, 5) if high - low <= 2 else (1,), max(1, round(30 * (high - low) / size))
        decades = range(math.floor(low), math.ceil(high) + 1, stride)
        return [(1.0, [value for decade in decades for factor in factors if low <= (value := decade + math.log10(factor)) <= high])]


class CurvePlot(pg.GraphicsView):
    """Curves with a legend, a cursor line and a read-out under the pointer.

    Values that are not finite leave gaps; with a logarithmic axis (`log`) also those that are not positive.
    """

    x_clicked = Signal(float)

    def __init__(self, parent: QWidget | None = None, log: bool = False) -> None:
        super().__init__(parent)
        self.setAccessibleName("Plot")
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._plot = layout = pg.GraphicsLayout()  # no PlotItem: its menus outlive it
        self.setCentralItem(layout)
        self._legend = layout.addLabel("", 0, 1, justify="left")
        self._box = layout.addViewBox(1, 1, enableMenu=False)
        self._axes = _Axis("left"), _Axis("bottom")
        for axis, place in zip(self._axes, ((1, 0), (2, 1)), strict=True):
            layout.addItem(axis, *place)
            axis.linkToView(self._box)
            axis.setZValue(-1)
            axis.enableAutoSIPrefix(False)
            axis.setGrid(60)
        layout.layout.setSpacing(0)
        layout.layout.setContentsMargins(2, 2, 10, 2)
        layout.geometryChanged.connect(lambda: self._axes[1].showLabel(self.height() > 130))
        self._log = log
        self._axes[0].setLogMode(y=log)
        self.series: dict[str, list[pg.GraphicsObject]] = {}  # the curve, its lone points, its band
        self._labels = "frame", ""
        self._message = "Nothing to plot yet"
        self._cursor, self._pointer = pg.InfiniteLine(), pg.InfiniteLine()
        for line in (self._cursor, self._pointer):
            self._box.addItem(line, ignoreBounds=True)
        self._apply_palette()
        self.set_labels()
        self.clear()

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
        old = self.series.pop(name, [])
        for item in old:
            self._box.removeItem(item)
        colour = colour or (old[0].opts["pen"].color() if old else class_colour(len(self.series)))
        x, y = np.asarray(x, float), np.where((np.abs(y) < LARGEST) & (np.asarray(y) > (0.0 if self._log else -LARGEST)), y, np.nan)
        known = np.pad(np.isfinite(y), 1)
        alone = known[1:-1] & ~known[:-2] & ~known[2:]
        pen, style = pg.mkPen(colour, width=1.6), {"connect": "finite", "antialias": True, "autoDownsample": True}
        items = [pg.PlotDataItem(x, y, pen=pen, **style)]
        items += [pg.PlotDataItem(x[alone], y[alone], pen=None, symbol="o", symbolPen=None, symbolBrush=colour, symbolSize=3.2)]
        for item in items:
            item.setLogMode(False, self._log)
        if band is not None:
            unknown = ~np.isfinite(band[0] + band[1]) | alone
            edges = [pg.PlotCurveItem(x, np.where(unknown, np.nan, edge), connect="finite") for edge in band]
            items.append(pg.FillBetweenItem(*edges, brush=faded(colour, 45)))
        for item in items:
            self._box.addItem(item)
        self.series[name] = items
        self._show_legend()

    def append(self, name: str, x: float, y: float) -> None:
        """Add one point to a curve, which is made when it does not exist."""
        xs, ys = self.points(name) if name in self.series else (np.zeros(0), np.zeros(0))
        self.set_series(name, np.append(xs, x), np.append(ys, y))

    def points(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Positions and values of a curve."""
        return self.series[name][0].getOriginalDataset()

    def remove(self, name: str) -> None:
        """Take a curve away; KeyError when there is none of that name."""
        self._remove(name)
        self._show_legend()

    def _remove(self, name: str) -> None:
        for item in self.series.pop(name):
            self._box.removeItem(item)

    def clear(self) -> None:
        """Take all curves away. The lines stay: PySide keeps a weak reference to an item for every time that it is added, for good."""
        for name in list(self.series):
            self._remove(name)
        for line in (self._cursor, self._pointer):
            line.hide()
        self._show_legend()

    def set_cursor(self, x: float | None) -> None:
        self._cursor.setVisible(x is not None)
        self._cursor.setValue(x or 0.0)

    def set_labels(self, x: str = "frame", y: str = "") -> None:
        self._labels = x, y
        self._axes[1].setLabel(x)
        self._show_legend()

    def hide_axes(self) -> None:
        """Show nothing but the curves, from 0 to 1."""
        self._box.setXRange(0.0, 1.0, padding=0.0)
        self._plot.layout.setContentsMargins(4, 3, 4, 3)
        for item in (*self._axes, self._legend):
            item.hide()

    def set_message(self, text: str) -> None:
        """What to say when there is no curve."""
        self._message = text
        self.viewport().update()

    def sizeHint(self) -> QSize:
        return QSize(320, 180)

    def minimumSizeHint(self) -> QSize:
        return QSize(140, 90)

    def _show_legend(self) -> None:
        """Names in a row on top; under the pointer, with the values there."""
        at = self._pointer.value() if self._pointer.isVisible() else None
        lead = self._labels[1] if at is None else f"{self._labels[0]} {short(at, 6)}"
        texts = [f'<span style="color: {self.palette().placeholderText().color().name()}">{escape(lead)}</span>']
        for name in self.series:
            x, y = self.points(name)
            near = "" if at is None or not len(x) else f" {short(y[np.argmin(np.abs(x - at))], 4)}"
            colour = self.series[name][0].opts["pen"].color().name()
            texts.append(f'<b style="color: {colour}">—</b> {escape(name + near)}')
        self._legend.setText("&nbsp;&nbsp; ".join(texts), color=self.palette().text().color())
        self._legend.setMinimumWidth(0)
        self._plot.setVisible(any(np.isfinite(self.points(name)[1]).any() for name in self.series))

    def _apply_palette(self) -> None:
        colours = self.palette()
        self.setBackground(colours.alternateBase().color())
        for axis in self._axes:
            axis.setPen(colours.mid().color())
            axis.setTextPen(colours.placeholderText().color())
        self._cursor.setPen(colours.accent().color(), width=1.4)
        self._pointer.setPen(colours.text().color(), style=Qt.PenStyle.DotLine)

    # Events

    def x_at(self, event: QMouseEvent) -> float:
        """The position on the x axis under the pointer."""
        self._box.updateAutoRange()
        return self._box.mapSceneToView(event.position()).x()

    def _point(self, event: QMouseEvent) -> None:
        """Show the values at the point of a curve that is nearest to the pointer; with the left button down it is clicked."""
        self._pointer.setVisible(self._plot.isVisible())
        if self._plot.isVisible():
            x = np.concatenate([self.points(name)[0] for name in self.series])
            self._pointer.setValue(x[np.argmin(np.abs(x - self.x_at(event)))])
            if event.buttons() & Qt.MouseButton.LeftButton:
                self.x_clicked.emit(self._pointer.value())
        self._show_legend()

    mousePressEvent = mouseMoveEvent = _point

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """A click is told when the button goes down."""

    def leaveEvent(self, event: QEvent) -> None:
        self._pointer.hide()
        self._show_legend()

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        if not self._plot.isVisible():
            with QPainter(self.viewport()) as painter:
                painter.setPen(self.palette().color(QPalette.ColorRole.PlaceholderText))
                flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap.value
                painter.drawText(self.rect().adjusted(12, 12, -12, -12), flags, self._message)

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_pointer"):  # also called from the base class's constructor
            self._apply_palette()
            self._show_legend()
