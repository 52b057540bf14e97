"""The numbers under the cursor, and beside them how they change over time."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Signal
from PySide6.QtGui import QColor, QPixmap
from PySide6.QtWidgets import QFrame, QHeaderView, QWidget

from degense.widgets import forms
from degense.widgets.curve_plot import CurvePlot
from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import ARROWS, keep_keys

#: Rows of values that are seen without scrolling however little room there is.
FEWEST_ROWS = 3


class ProbePanel(QWidget):
    """A table of values and `plots` of curves for one place, which follows the pointer or is pinned: a layer's, and similarities."""

    frame_clicked = Signal(int)
    unpin_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Probe")
        self._place = forms.label()
        self._swatch = forms.label(name="Colour under the cursor", wrap=False)
        self._unpin = GlyphButton("cross", "Follow the pointer again", clicked=self.unpin_requested.emit)
        self._table = forms.table("Values", ["", ""])
        self._table.setFrameShape(QFrame.Shape.NoFrame)
        self._table.viewport().setAutoFillBackground(False)
        self._table.horizontalHeader().hide()
        self._table.setMinimumHeight(FEWEST_ROWS * self._table.verticalHeader().defaultSectionSize())
        self._table.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        keep_keys(self._table, ARROWS)
        self.plot, self.similarity = CurvePlot(), CurvePlot()
        self.plot.setAccessibleName("Values over time")
        self.plot.set_message("Click in the 2D view to follow a place through time")
        self.similarity.setAccessibleName("Similarity over time")
        self.similarity.set_labels("frame", "cosine")
        for plot in (self.plot, self.similarity):
            plot.x_clicked.connect(lambda x: self.frame_clicked.emit(round(x)))
        self.plots = QWidget()
        forms.row((self.plot, 1), (self.similarity, 1), parent=self.plots)
        place = forms.row(self._swatch, (self._place, 1), self._unpin)
        forms.row((forms.column(place, (self._table, 1), margin=0), 2), (self.plots, 5), parent=self).setContentsMargins(6, 0, 6, 6)
        self.clear()

    def set_values(self, rows: Sequence[tuple[str, str]]) -> None:
        """Show (label, text) pairs in this order."""
        forms.fill(self._table, rows)

    def set_colour(self, colour: QColor | None) -> None:
        """A swatch of the colour there; None hides it."""
        self._swatch.setVisible(colour is not None)
        if colour is not None:
            side = self.fontMetrics().height()
            pixmap = QPixmap(side, side)
            pixmap.fill(colour)
            self._swatch.setPixmap(pixmap)

    def set_pinned(self, text: str) -> None:
        """Say where the probe is pinned; empty: it follows the pointer."""
        self._place.setText(text or "Under the pointer")
        self._unpin.setVisible(bool(text))

    def set_cursor(self, frame: int) -> None:
        self.plot.set_cursor(frame)
        self.similarity.set_cursor(frame)

    def clear_curves(self) -> None:
        self.plot.clear()
        self.similarity.clear()
        self.similarity.hide()

    def clear(self) -> None:
        self.set_values([])
        self.set_colour(None)
        self.set_pinned("")
        self.clear_curves()
