"""How much of each frame the masks of the prompts cover, over the whole clip."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from PySide6.QtCore import Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QWidget

from degense.widgets import forms
from degense.widgets.curve_plot import CurvePlot


class AreaPanel(QWidget):
    """A curve for each prompt; frames that are not computed yet are gaps."""

    frame_clicked = Signal(int)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Areas")
        self.plot = CurvePlot()
        self.plot.setAccessibleName("Areas of the masks over time")
        self.plot.set_labels("frame", "area [% of the frame]")
        self.plot.set_message("Type a prompt: how much of each frame it finds is plotted here")
        self.plot.x_clicked.connect(lambda x: self.frame_clicked.emit(round(x)))
        forms.column(self.plot, margin=0, parent=self).setContentsMargins(6, 0, 6, 6)

    def set_curves(self, curves: Mapping[str, tuple[np.ndarray, QColor]]) -> None:
        """Show these and no others: shares of the frame in [0, 1], float [T], NaN where they are not known, and their colours."""
        for name in [name for name in self.plot.series if name not in curves]:
            self.plot.remove(name)
        for name, (shares, colour) in curves.items():
            self.plot.set_series(name, np.arange(len(shares)), 100 * shares, colour)
