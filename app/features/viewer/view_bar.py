"""A small colour bar that lies over a view, so that values can be read beside the frame."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtWidgets import QFrame, QLabel, QWidget

from degense.widgets import forms
from degense.widgets.colour_bar import Gradient

_EDGE, _HEIGHT = 8, 124


class ViewBar(QFrame):
    """Lies in the upper right corner of the widget that it is given, below its note where there is no room, and lets the mouse through."""

    def __init__(self, host: QWidget) -> None:
        super().__init__(host)
        self._host = host
        self.setObjectName("viewBar")
        self.setAccessibleName("Colour bar in the view")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._title, self._gradient = forms.label(wrap=False), Gradient(12)
        self._gradient.setFixedHeight(_HEIGHT)
        forms.column(self._title, self._gradient, margin=_EDGE, spacing=0, parent=self)
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
        self.adjustSize()
        left, top = self._host.width() - self.width() - _EDGE, _EDGE
        note = self._host.findChild(QLabel, "viewNote")
        if note is not None and not note.isHidden() and left <= note.geometry().right() + _EDGE:
            top += note.geometry().bottom() + 1
        self.move(left, top)
