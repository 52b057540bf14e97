"""The parts of the window, from one to the next by a key, and panels that are entered as they are opened."""

from __future__ import annotations

from collections.abc import Iterator

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QApplication, QDockWidget, QWidget

from degense.app.shell.docks import Docks


class Panes(QObject):
    """Views, what stands below them, and panels. Each gets the keyboard back where it had it last."""

    def __init__(self, docks: Docks) -> None:
        super().__init__(docks)
        self._docks = docks
        self._last: dict[QWidget, QWidget] = {}  # pane → what had the keyboard in it
        QApplication.instance().focusChanged.connect(self._remember)  # type: ignore[union-attr]

    def _all(self) -> list[QWidget]:
        """The views from the left, what stands below them, and the panels from above."""
        views = [view for place in range(self._docks.views.count()) if (view := self._docks.views.widget(place)) is not None]
        return [*views, *self._docks.below, *sorted(self._docks.all, key=self._docks.drawer.count)]

    def step(self, by: int) -> None:
        """Give the keyboard to the next part, or to the one before with −1."""
        panes = [pane for pane in self._all() if pane.isVisible() and next(_stops(pane), None) is not None]
        here = QApplication.focusWidget()
        place = next((place for place, pane in enumerate(panes) if here is not None and _holds(pane, here)), -1 if by > 0 else 0)
        if panes:
            self._give(panes[(place + by) % len(panes)])

    def enter(self, dock: QDockWidget) -> None:
        """Open a panel and give it the keyboard."""
        self._docks.bring(dock)
        self._give(dock)

    def _give(self, pane: QWidget) -> None:
        stops = list(_stops(pane))
        last = self._last.get(pane)
        if isinstance(pane, QDockWidget):
            pane.raise_()  # from behind its neighbours in tabs
        if stops:
            (last if last in stops else stops[0]).setFocus(Qt.FocusReason.TabFocusReason)

    def _remember(self, before: QWidget | None, now: QWidget | None) -> None:
        if now is not None:
            for pane in self._all():
                if _holds(pane, now):
                    self._last[pane] = now


def _holds(pane: QWidget, widget: QWidget) -> bool:
    return pane is widget or pane.isAncestorOf(widget)


def _stops(pane: QWidget) -> Iterator[QWidget]:
    """What Tab stops at in a part, in its order; the title bar of a panel aside."""
    inside = pane.widget() if isinstance(pane, QDockWidget) else pane
    widget: QWidget | None = inside
    while widget is not None:
        stops = widget.focusPolicy() & Qt.FocusPolicy.TabFocus and widget.isEnabled() and widget.isVisible()
        if stops and _holds(inside, widget):
            yield widget
        widget = widget.nextInFocusChain()
        if widget is inside:
            return
