"""A small colour bar that lies over a view, so that values can be read beside the frame."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QSize, Qt
from PySide6.QtWidgets import QFrame, QWidget

from degense.widgets import forms
from degense.widgets.colour_bar import Gradient
from degense.widgets.elided import ElidedLabel

_EDGE = 8


class ViewBar(QFrame):
    """Lies in the upper right corner of a widget, below the words in the other corner where it is wide, and lets the mouse
    through.
    """

    def __init__(self, host: QWidget) -> None:
        super().__init__(host)
        self._host = host
        self.setObjectName("viewBar")
        self.setAccessibleName("Colour bar in the view")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._title, self._gradient = ElidedLabel(), Gradient()
        forms.column(self._title, self._gradient, margin=_EDGE, spacing=2, parent=self)
        host.installEventFilter(self)
        self.hide()

    def show_range(self, title: str, low: float, high: float, cmap: str, beyond: tuple[bool, bool]) -> None:
        """Show the numbers of the first and the last colour, under a title with the unit, and whether values lie beyond them."""
        self._title.setText(title)
        self._gradient.low, self._gradient.high, self._gradient.cmap = low, high, cmap
        self._gradient.beyond = beyond
        self._gradient.update()
        self.show()
        self.raise_()
        self._stay()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.Resize, QEvent.Type.Show):
            self._stay()
        return False

    def _stay(self) -> None:
        room = self._host.width() - 2 * _EDGE
        self.resize(self.sizeHint().boundedTo(QSize(room, self._host.height())))
        below = self.width() > room / 2
        self.move(self._host.width() - self.width() - _EDGE, _EDGE + below * (self.fontMetrics().height() + _EDGE))
