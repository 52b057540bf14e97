"""A mouse and a keyboard: each sends events to the window system's windows, as a hand does, and counts what it did."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QAction
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMenu, QWidget

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier


def top() -> QWidget:
    """The window that gets keys, from which Qt hands them on to what has popped up."""
    found = QApplication.activeModalWidget() or QApplication.activeWindow()
    assert found is not None, "no window has the keyboard"
    return found


class Mouse:
    """A click, a double click and a drag are a step each."""

    def __init__(self, window: QWidget, settle: Callable[[], None], until: Callable[[Callable[[], bool]], None]) -> None:
        self.window, self.settle, self.until, self.steps = window, settle, until, 0

    def click(self, widget: QWidget, at: QPoint | None = None, *, twice: bool = False) -> None:
        assert widget.isVisible()
        assert widget.isEnabled()
        at = widget.rect().center() if at is None else at
        self._send(QTest.mouseDClick if twice else QTest.mouseClick, widget, at)

    def drag(self, widget: QWidget, start: QPoint, end: QPoint) -> None:
        handle = widget.window().windowHandle()
        start, end = (widget.mapTo(widget.window(), point) for point in (start, end))
        QTest.mousePress(handle, LEFT, NONE, start)
        for part in range(1, 9):
            QTest.mouseMove(handle, start + (end - start) * part / 8)
        QTest.mouseRelease(handle, LEFT, NONE, end)
        self._done()

    def choose(self, *titles: str) -> None:
        """An entry of the menu bar, of a menu in it, and so on."""
        bar = self.window.menuBar()
        [entry] = [action for action in bar.actions() if action.text().replace("&", "") == titles[0]]
        self._send(QTest.mouseClick, bar, bar.actionGeometry(entry).center())
        for title in titles[1:]:
            self.pick(title)

    def pick(self, title: str) -> None:
        """An entry of the menu that is open, or that comes. One with a submenu is pointed at, which opens it: where a button is let go over
        it just as the submenu comes, as on a slow machine, Qt takes the menu below for the active one."""

        def entries() -> list[QAction]:
            menu = QApplication.activePopupWidget()
            actions = menu.actions() if isinstance(menu, QMenu) else []
            return [action for action in actions if action.text().rstrip("…") == title or action.text().startswith(f"{title}:")]

        self.until(lambda: len(entries()) == 1)
        menu, [entry] = QApplication.activePopupWidget(), entries()
        assert isinstance(menu, QMenu)
        assert entry.isEnabled(), title
        at = menu.actionGeometry(entry).center()
        if entry.menu() is None:
            self._send(QTest.mouseClick, menu, at)
        else:
            QTest.mouseMove(menu.windowHandle(), at)
            self._done()

    def _send(self, event: Callable[..., None], widget: QWidget, at: QPoint) -> None:
        event(widget.window().windowHandle(), LEFT, NONE, widget.mapTo(widget.window(), at))
        self._done()

    def _done(self) -> None:
        self.steps += 1
        self.settle()


class Keys:
    """A key, with those that are held, and a typed text are a step each."""

    def __init__(self, window: QWidget, settle: Callable[[], None], until: Callable[[Callable[[], bool]], None]) -> None:
        self.window, self.settle, self.until, self.steps = window, settle, until, 0

    def press(self, *which: Qt.Key, held: Qt.KeyboardModifier = NONE) -> None:
        for key in which:
            QTest.keyClick(top().windowHandle(), key, held)
            self.steps += 1
            self.settle()

    def type(self, text: str) -> None:
        for letter in text:
            QTest.keyClick(top().windowHandle(), letter)
        self.steps += 1
        self.settle()
