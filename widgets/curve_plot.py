"""A small line plot: several named curves over frames or iterations."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QEvent, QSize, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter
from PySide6.QtWidgets import QWidget

from degense.widgets import forms
from degense.widgets.numbers import short
from degense.widgets.theme import class_colour

if TYPE_CHECKING:
    from degense.widgets.curve_view import CurveView

#: Larger values are gaps: the axis could not be computed.
LARGEST = 1e100


@dataclass(frozen=True)
class Curve:
    """A curve with x ascending; y is NaN in gaps."""

    x: np.ndarray
    y: np.ndarray
    colour: QColor
    band: tuple[np.ndarray, np.ndarray] | None


class CurvePlot(forms.PaintedWidget):
    """Curves with a legend, a cursor line and a read-out under the pointer.

    Values that are not finite leave gaps; with a logarithmic axis (`log`) also those that are not positive. What draws the curves is made
    with the first of them: the window comes without pyqtgraph, which takes 0.16 s to load.
    """

    x_clicked = Signal(float)

    def __init__(self, parent: QWidget | None = None, log: bool = False, bare: bool = False) -> None:
        """`bare`: nothing but the curves, from 0 to 1."""
        super().__init__(parent)
        self.setAccessibleName("Plot")
        self.setMouseTracking(True)
        self.setAutoFillBackground(True)
        self.setBackgroundRole(self.palette().ColorRole.AlternateBase)
        self._room = forms.column(margin=0, parent=self)
        self._log, self._bare = log, bare
        self.series: dict[str, Curve] = {}
        self._labels = "frame", ""
        self._message = "Nothing to plot yet"
        self._cursor: float | None = None
        self._pointer: float | None = None
        self._view: CurveView | None = None

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
        if self._view is not None:
            self._draw(self._view, name)
        self._refresh()

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
        if self._view is not None:
            self._view.remove(name)
        self._refresh()

    def clear(self) -> None:
        """Take all curves away, and the cursor."""
        self._cursor = self._pointer = None
        for name in list(self.series):
            self.remove(name)
        self._refresh()

    def set_cursor(self, x: float | None) -> None:
        self._cursor = x
        if self._view is not None:
            self._view.set_lines(self._cursor, self._pointer)

    def set_labels(self, x: str = "frame", y: str = "") -> None:
        """What the axes count, with the unit."""
        self._labels = x, y
        self._refresh()

    def set_message(self, text: str) -> None:
        """What to say when there is no curve."""
        self._message = text
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(320, 180)

    def minimumSizeHint(self) -> QSize:
        return QSize(140, 90)

    def is_empty(self) -> bool:
        """Whether no curve has a point."""
        return not any(np.isfinite(curve.y).any() for curve in self.series.values())

    # Showing

    def _refresh(self) -> None:
        """Show the view where there is something to see, with its legend and lines."""
        if self._view is None and not self.is_empty():
            from degense.widgets.curve_view import CurveView

            self._view = CurveView(self, self._log, self._bare)
            self._view.room_changed.connect(self._refresh)
            for name in self.series:
                self._draw(self._view, name)
            self._room.addWidget(self._view)
        if self._view is not None:
            below, beside = self._labels
            self._view.set_legend(self._legend(), beside, below)
            self._view.set_lines(self._cursor, self._pointer)
            self._view.setVisible(not self.is_empty())

    def _draw(self, view: CurveView, name: str) -> None:
        curve = self.series[name]
        view.draw(name, curve.x, curve.y, curve.colour, curve.band)

    def _legend(self) -> str:
        """Names in a row, after what the axis counts where it has no room for that; under the pointer, with the values there."""
        at, apart = self._pointer, self._view is not None and not self._view.has_labels()
        lead = f"{self._labels[0]} {short(at, 6)}" if at is not None else self._labels[1] if apart else ""
        texts = [f'<span style="color: {self.palette().placeholderText().color().name()}">{escape(lead)}</span>']
        for name, curve in self.series.items():
            near = "" if at is None or not len(curve.x) else f" {short(curve.y[np.argmin(np.abs(curve.x - at))], 4)}"
            texts.append(f'<b style="color: {curve.colour.name()}">—</b> {escape(name + near)}')
        return "&nbsp;&nbsp; ".join(texts)

    def _paint(self, painter: QPainter) -> None:
        if self.is_empty():
            painter.setPen(self.palette().placeholderText().color())
            flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap.value
            painter.drawText(self.rect().adjusted(12, 12, -12, -12), flags, self._message)

    # Events

    def x_at(self, event: QMouseEvent) -> float:
        """The position on the x axis under the pointer; curves are shown."""
        assert self._view is not None
        return self._view.x_at(event.position().x())

    def _point(self, event: QMouseEvent) -> None:
        """Show the values at the point of a curve that is nearest to the pointer; with the left button down it is clicked."""
        if self.is_empty():
            return
        x = np.concatenate([curve.x for curve in self.series.values()])
        self._pointer = float(x[np.argmin(np.abs(x - self.x_at(event)))])
        self._refresh()
        if event.buttons() & Qt.MouseButton.LeftButton:
            self.x_clicked.emit(self._pointer)

    mousePressEvent = mouseMoveEvent = _point

    def leaveEvent(self, event: QEvent) -> None:
        self._pointer = None
        self._refresh()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_view"):  # also called from the base class's constructor
            self._refresh()
