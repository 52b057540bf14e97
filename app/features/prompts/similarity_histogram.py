"""Histogram of the similarities of the pixels to each prompt, with the threshold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QSize, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from degense.widgets.curve_plot import CurvePlot


class SimilarityHistogram(CurvePlot):
    """One curve a prompt over the similarity from 0 to 1, and the threshold as a line that can be dragged.

    Heights are square roots of shares: most pixels lie outside the mask, and would dwarf those inside.
    """

    threshold_dragged = Signal(float)  # (threshold)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent, bare=True)
        self.setAccessibleName("Histogram of the similarities")
        self.setToolTip("How many pixels are how similar to each prompt; drag the line to move the threshold")
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setCursor(Qt.CursorShape.SplitHCursor)
        self._threshold = 0.5

    def set_curves(self, curves: Sequence[tuple[np.ndarray, QColor]]) -> None:
        """Show counts [bins] over equal steps from 0 to 1, each in its colour."""
        self.clear()
        for index, (counts, colour) in enumerate(curves):
            heights = np.sqrt(counts / max(float(counts.sum()), 1.0))
            self.set_series(str(index), (np.arange(len(counts)) + 0.5) / len(counts), heights, colour, (np.zeros_like(heights), heights))
        self.set_cursor(self._threshold)
        self.setVisible(bool(curves))

    def set_threshold(self, threshold: float) -> None:
        self._threshold = threshold
        self.set_cursor(threshold)

    def sizeHint(self) -> QSize:
        return QSize(200, 52)

    minimumSizeHint = sizeHint

    def _point(self, event: QMouseEvent) -> None:
        if event.buttons() & Qt.MouseButton.LeftButton:
            self.set_threshold(min(max(self.x_at(event), 0.0), 1.0))
            self.threshold_dragged.emit(self._threshold)

    mousePressEvent = mouseMoveEvent = _point
