"""The panels beside the views: below each other where there is room for all, else in tabs."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

from PySide6.QtCore import QEvent, QObject, Qt, QTimer, Signal
from PySide6.QtWidgets import QDockWidget, QMainWindow, QScrollArea, QStyle, QWidget

#: Height that a panel has at least below another, lines of text; more where its controls need it.
LINES = 13
#: Height of a title or of tabs beyond that of its text, pixels.
BAR = 12


class Column(QObject):
    """Decides anew when the height beside the views or the size of the text changes, never because of what a panel shows."""

    text_resized = Signal()

    def __init__(self, window: QMainWindow, centre: QWidget, panels: Callable[[], list[QDockWidget]]) -> None:
        super().__init__(window)
        self._window, self._centre, self._panels = window, centre, panels
        self._in_tabs = False  # by this, and not by the user's own hand
        self._heights: list[int] = []  # when they last stood below each other with room
        self._decided = -1  # the height of the centre that was decided for
        for watched in (window, centre):
            watched.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.Resize, QEvent.Type.FontChange):
            if event.type() == QEvent.Type.FontChange and watched is self._window:
                self._decided = -1
                QTimer.singleShot(0, self, self.text_resized.emit)
            QTimer.singleShot(0, self, self.decide)
        return False

    def needed(self) -> int:
        """Height in which all controls of any one panel can be seen, with its title and its tab."""
        return max(map(_least, self._open()), default=0) + 2 * self._bar()

    def width(self) -> int:
        """Width in which all controls of every panel can be seen."""
        bar = self._window.style().pixelMetric(QStyle.PixelMetric.PM_ScrollBarExtent)
        return max((content.minimumSizeHint().width() for dock in self._open() if (content := _content(dock)) is not None), default=0) + bar

    def decide_anew(self) -> None:
        """After a saved arrangement has come: its tabs may be of a smaller window."""
        self._in_tabs, self._decided = True, -1
        self.decide()

    def decide(self) -> None:
        """Lay the panels below each other, or over each other with a tab each."""
        docks = self._open()
        if len(docks) < 2 or self._decided == self._centre.height():
            return
        self._decided = self._centre.height()
        tabs = bool(self._window.tabifiedDockWidgets(docks[0]))
        if sum(map(self._height, docks)) > self._decided:
            if not tabs:
                for before, dock in pairwise(docks):
                    self._window.tabifyDockWidget(before, dock)
                docks[0].raise_()
                self._in_tabs = True
        elif not tabs:
            heights, needed = [dock.height() for dock in docks], [self._whole(dock) for dock in docks]
            if sum(needed) > self._decided:
                needed = [self._height(dock) for dock in docks]
            if all(height >= least for height, least in zip(heights, needed, strict=True)):
                self._heights = heights
            else:
                self._window.resizeDocks(docks, needed, Qt.Orientation.Vertical)
        elif self._in_tabs:
            for dock in docks[1:]:
                self._window.addDockWidget(self._window.dockWidgetArea(docks[0]), dock)
            if len(self._heights) == len(docks):
                self._window.resizeDocks(docks, self._heights, Qt.Orientation.Vertical)
            self._in_tabs = False

    def _open(self) -> list[QDockWidget]:
        return [dock for dock in self._panels() if not dock.isHidden()]

    def _height(self, dock: QDockWidget) -> int:
        return max(_least(dock), LINES * self._window.fontMetrics().height()) + self._bar()

    def _whole(self, dock: QDockWidget) -> int:
        """Height in which nothing of a panel is scrolled."""
        content = _content(dock)
        return max(self._height(dock), (content.sizeHint().height() if content is not None else 0) + self._bar())

    def _bar(self) -> int:
        """Height of a title, or of the tabs, with what is free around it."""
        return self._window.fontMetrics().height() + BAR


def _least(dock: QDockWidget) -> int:
    """Height that the content of a panel needs, pixels."""
    content = _content(dock)
    return content.minimumSizeHint().height() if content is not None else 0


def _content(dock: QDockWidget) -> QWidget | None:
    area = dock.widget()
    return area.widget() if isinstance(area, QScrollArea) else area
