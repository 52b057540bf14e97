"""The palette of the real window: a word is typed, and Enter runs what it means."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog

from degense.app.shell.palette import Palette
from degense.app.shell.shell import Shell
from tests.app import installed as on


@pytest.fixture
def find(qtbot, opened) -> Callable[[str], Palette]:
    """Open the palette by its key and type into it."""

    def find(text: str) -> Palette:
        on.viewer(opened).panel.setFocus()
        QTest.keyClick(opened.windowHandle(), Qt.Key.Key_K, Qt.KeyboardModifier.ControlModifier)
        qtbot.waitUntil(lambda: isinstance(QApplication.activePopupWidget(), Palette))
        palette = QApplication.activePopupWidget()
        assert isinstance(palette, Palette)
        for letter in text:
            QTest.keyClick(palette.windowHandle(), letter)
        assert palette.input.text() == text
        return palette

    return find


def enter(palette: Palette) -> None:
    QTest.keyClick(palette.windowHandle(), Qt.Key.Key_Return)


def first(palette: Palette) -> str:
    item = palette.list.item(0)
    return item.text() if item is not None else ""


def dialogs(window: Shell) -> list[str]:
    return [dialog.windowTitle() for dialog in window.findChildren(QDialog) if dialog.isVisible() and not isinstance(dialog, Palette)]


@pytest.mark.parametrize("word", ["movie", "film"])
def test_a_movie_is_made(opened, find, word, screenshot):
    palette = find(word)
    assert first(palette) == "File ▸ Export ▸ Movie…"
    screenshot(opened, f"palette-{word}")
    enter(palette)
    assert dialogs(opened) == ["Movie"]
    [dialog] = [dialog for dialog in opened.findChildren(QDialog) if dialog.isVisible()]
    dialog.reject()


def test_a_ruler_measures(opened, find):
    enter(find("ruler"))
    assert on.measuring(opened).has_tool("distance")


def test_exit_closes_the_window(qtbot, opened, find):
    enter(find("exit"))
    qtbot.waitUntil(lambda: not opened.isVisible())


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("video", "File ▸ Open video…"),
        ("screenshot", "File ▸ Export ▸ Frame as shown…"),
        ("transparent masks", "View ▸ More opaque masks"),
        ("3d background", "Edit ▸ Preferences…"),
        ("measure", "Inspect ▸ Measure ▸ Measure a distance"),
        ("close", "File ▸ Close"),
        ("revert", "Edit ▸ Undo"),
        ("export", "File ▸ Export ▸ Frame as shown…"),
    ],
)
def test_words_find_what_they_mean(opened, find, words, found):
    opened.session.view.add_prompt("liver")
    opened.refresh()
    palette = find(words)
    assert first(palette) == found
    QTest.keyClick(palette.windowHandle(), Qt.Key.Key_Escape)
