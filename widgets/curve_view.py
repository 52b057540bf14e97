"""The curves of a plot, drawn by pyqtgraph, which is loaded with this module."""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPointF, Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from degense.widgets.theme import faded

#: Width of a curve, diameter of a point that stands alone; opacity of a band and of the grid, of 255.
LINE, POINT, BAND, GRID = 1.6, 3.2, 45, 60
#: Height from which the axes say what they count.
WITH_LABEL = 130


class _Axis(pg.AxisItem):
    """Logarithmic, it has powers of ten, with their doubles and fives where the range is short: pyqtgraph's own labels overlap."""

    def logTickValues(self, low: float, high: float, size: float, linear: object) -> list[tuple[float, list[float]]]:
        factors, stride = (1, 2, 5) if high - low <= 2 else (1,), max(1, round(30 * (high - low) / size))
        decades = range(math.floor(low), math.ceil(high) + 1, stride)
        return [(1.0, [value for decade in decades for factor in factors if low <= (value := decade + math.log10(factor)) <= high])]


class CurveView(pg.GraphicsView):
    """Curves between their axes, with a legend, a cursor line and a line under the pointer; the mouse goes to what lies below.

    `bare`: nothing but the curves, from 0 to 1.
    """

    room_changed = Signal()  # `has_labels` has changed

    def __init__(self, parent: QWidget, log: bool, bare: bool) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        layout = pg.GraphicsLayout()  # no PlotItem: its menus outlive it
        self.setCentralItem(layout)
        self._legend = layout.addLabel("", 0, 1, justify="left")
        self._box = layout.addViewBox(1, 1, enableMenu=False)
        self._axes = _Axis("left"), _Axis("bottom")
        for axis, place in zip(self._axes, ((1, 0), (2, 1)), strict=True):
            layout.addItem(axis, *place)
            axis.linkToView(self._box)
            axis.setZValue(-1)
            axis.enableAutoSIPrefix(False)
            axis.setGrid(GRID)
        layout.layout.setSpacing(0)
        layout.layout.setContentsMargins(*((4, 3, 4, 3) if bare else (2, 2, 10, 2)))
        if bare:
            self._box.setXRange(0.0, 1.0, padding=0.0)
            for item in (*self._axes, self._legend):
                item.hide()
        else:
            layout.geometryChanged.connect(self._show_labels)
        self._labelled, self._bare = False, bare
        self._log = log
        self._axes[0].setLogMode(y=log)
        self._items: dict[str, list[pg.GraphicsObject]] = {}  # the curve, its lone points, its band
        self._cursor, self._pointer = pg.InfiniteLine(), pg.InfiniteLine()
        for line in (self._cursor, self._pointer):
            self._box.addItem(line, ignoreBounds=True)
        self._apply_palette()

    def draw(self, name: str, x: np.ndarray, y: np.ndarray, colour: QColor, band: tuple[np.ndarray, np.ndarray] | None) -> None:
        """Add or replace a curve; y is NaN in gaps."""
        self.remove(name)
        known = np.pad(np.isfinite(y), 1)
        alone = known[1:-1] & ~known[:-2] & ~known[2:]
        style = {"connect": "finite", "antialias": True, "autoDownsample": True}
        dots = {"pen": None, "symbol": "o", "symbolPen": None, "symbolBrush": colour, "symbolSize": POINT}
        items = [pg.PlotDataItem(x, y, pen=pg.mkPen(colour, width=LINE), **style)]
        items += [pg.PlotDataItem(x[alone], y[alone], **dots)]
        for item in items:
            item.setLogMode(False, self._log)
        if band is not None:
            unknown = ~np.isfinite(band[0] + band[1]) | alone
            edges = [pg.PlotCurveItem(x, np.where(unknown, np.nan, edge), connect="finite") for edge in band]
            items.append(pg.FillBetweenItem(*edges, brush=faded(colour, BAND)))
        for item in items:
            self._box.addItem(item)
        self._items[name] = items

    def remove(self, name: str) -> None:
        """Take a curve away if it is there."""
        for item in self._items.pop(name, []):
            self._box.removeItem(item)

    def set_lines(self, cursor: float | None, pointer: float | None) -> None:
        """Where they stand; None hides one. They are never removed: PySide keeps a weak reference for every time that an item is added."""
        for line, x in ((self._cursor, cursor), (self._pointer, pointer)):
            line.setVisible(x is not None)
            line.setValue(x or 0.0)

    def has_labels(self) -> bool:
        """Whether there is room for what the axes count."""
        return self.height() > WITH_LABEL

    def _show_labels(self) -> None:
        for axis in self._axes:
            axis.showLabel(self.has_labels() and bool(axis.labelText))
        if self._labelled != self.has_labels():
            self._labelled = self.has_labels()
            self.room_changed.emit()

    def set_legend(self, html: str, beside: str, below: str) -> None:
        """The text on top, and what the two axes count."""
        self._legend.setText(html, color=self.palette().text().color())
        self._legend.setMinimumWidth(0)
        for axis, words in zip(self._axes, (beside, below), strict=True):
            if axis.labelText != words:
                axis.setLabel(words)
        if not self._bare:
            self._show_labels()

    def x_at(self, x: float) -> float:
        """The position on the x axis at a pixel of this widget."""
        self._box.updateAutoRange()
        return float(self._box.mapSceneToView(QPointF(x, 0.0)).x())

    def _apply_palette(self) -> None:
        colours = self.palette()
        self.setBackground(colours.alternateBase().color())
        for axis in self._axes:
            axis.setPen(colours.mid().color())
            axis.setTextPen(colours.placeholderText().color())
        self._cursor.setPen(colours.accent().color(), width=1.4)
        self._pointer.setPen(colours.text().color(), style=Qt.PenStyle.DotLine)
        self._legend.setText(self._legend.text, color=colours.text().color())

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_pointer"):  # also called from the base class's constructor
            self._apply_palette()
