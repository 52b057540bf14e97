"""Menus opened by their letters, and Tab all round the window."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMenu, QWidget

from tests.app import installed as on

ALT = Qt.KeyboardModifier.AltModifier


def test_each_menu_opens_by_its_letter(qtbot, opened, screenshot):
    bar = opened.menuBar()
    letters = [action.text().partition("&")[2][:1].upper() for action in bar.actions()]
    assert letters == ["F", "E", "V", "I", "A", "P", "T", "H"]
    on.viewer(opened).panel.setFocus()
    for letter, action in zip(letters, bar.actions(), strict=True):
        QTest.keyClick(opened.windowHandle(), getattr(Qt.Key, f"Key_{letter}"), ALT)
        qtbot.waitUntil(lambda action=action: QApplication.activePopupWidget() is action.menu())
        if letter == "V":
            screenshot(opened, "menu-by-letter")
        QTest.keyClick(QApplication.activePopupWidget().windowHandle(), Qt.Key.Key_Escape)
        qtbot.waitUntil(lambda: not isinstance(QApplication.activePopupWidget(), QMenu))


def stops(window: QWidget) -> list[QWidget]:
    """What Tab should stop at: all that can be seen and that takes the keyboard so."""
    return [
        widget
        for widget in window.findChildren(QWidget)
        if widget.window() is window
        and widget.focusPolicy() & Qt.FocusPolicy.TabFocus
        and widget.focusProxy() is None
        and widget.isEnabled()
        and widget.isVisible()
    ]


def test_tab_goes_round_the_whole_window(opened, idle):
    """With prompts, layers and the drawer open: Tab stops at every control and comes back to where it started; Shift+Tab goes back."""
    opened.session.view.add_prompt("liver")
    opened.docks.bring(on.dock(opened, "Findings"))
    idle()
    start = on.viewer(opened).panel
    start.setFocus()
    wanted, seen = stops(opened), [start]
    for _ in range(3 * len(wanted)):
        QTest.keyClick(opened.windowHandle(), Qt.Key.Key_Tab)
        now = QApplication.focusWidget()
        assert now is not None
        assert now.window() is opened
        if now is start:
            break
        assert now not in seen, f"Tab goes round in a part of the window, from {now} on"
        seen.append(now)
    assert QApplication.focusWidget() is start
    missed = [f"{type(widget).__name__} {widget.accessibleName()!r}" for widget in wanted if widget not in seen]
    assert not missed
    assert len(seen) > 30
    QTest.keyClick(opened.windowHandle(), Qt.Key.Key_Backtab, Qt.KeyboardModifier.ShiftModifier)
    assert QApplication.focusWidget() is seen[-1]
