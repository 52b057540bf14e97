"""Typing prompts, with real keys."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QColor, QKeySequence
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QComboBox, QLabel, QLineEdit, QMainWindow, QSlider, QWidget

from degense.app.features.prompts.panel import PromptBar
from degense.app.features.prompts.prompt_row import PromptRow
from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import consumes_key
from degense.widgets.theme import class_colour


@pytest.fixture
def bar(show):
    return show(PromptBar(), 340, 300)


def field(bar):
    return bar.findChild(QLineEdit)


def press(bar, name):
    QTest.mouseClick(next(b for b in bar.findChildren(GlyphButton) if b.accessibleName() == name), Qt.MouseButton.LeftButton)


@pytest.fixture
def added(bar):
    heard: list = []
    bar.prompt_added.connect(lambda row: heard.append((row, row.text)))
    return heard


@pytest.mark.parametrize("width", [210, 240, 400])
def test_a_name_is_not_cut_for_its_numbers(show, width):
    around = show(QWidget(), 500, 200)
    row = PromptRow("gallbladder", QColor("orange"), True, around)
    row.resize(width, 60)
    row.show()
    row.set_answer(0.3, 0.79)
    QTest.qWait(20)
    needed = row.fontMetrics().horizontalAdvance("gallbladder")
    assert row.name.width() >= needed
    assert row.answer.width() >= row.fontMetrics().horizontalAdvance("30.0% · 0.79")
    assert (row.answer.y() > row.name.geometry().bottom()) == (width < 300)
    assert row.rect().contains(row.answer.geometry())


def test_enter_adds_a_chip(bar, added, qtbot):
    QTest.keyClicks(field(bar), "  the   hook ")
    QTest.keyClick(field(bar), Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: bool(added))
    QTest.keyClicks(field(bar), "liver")
    QTest.keyClick(field(bar), Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: len(added) == 2)
    first, second = bar.prompts()
    assert added == [(first, "the hook"), (second, "liver")]
    assert (first.colour, second.colour) == (class_colour(0), class_colour(1))
    assert first.visible
    assert first.error == ""
    assert field(bar).text() == ""


def test_nothing_and_the_same_again_add_nothing(bar, added, qtbot):
    known = bar.add_prompt("Liver")
    assert bar.add_prompt("liver") == known
    for text in ("", "   ", "LIVER"):
        field(bar).setText(text)
        QTest.keyClick(field(bar), Qt.Key.Key_Return)
        qtbot.wait(10)
    assert added == []
    assert len(bar.prompts()) == 1
    with pytest.raises(ValueError, match="at least one word"):
        bar.add_prompt(" ")


def test_completion(bar, added, qtbot):
    bar.set_completions(["gallbladder", "liver", "fat"])
    bar.focus_input()
    QTest.keyClicks(field(bar), "bla")
    popup = field(bar).completer().popup()
    qtbot.waitUntil(popup.isVisible)
    assert popup.model().rowCount() == 1
    QTest.keyClick(popup, Qt.Key.Key_Down)
    QTest.keyClick(popup, Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: field(bar).text() == "gallbladder" or bool(added))
    qtbot.waitUntil(lambda: not popup.isVisible())  # while it is shown, keys are its own
    if not added:
        QTest.keyClick(field(bar), Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: [text for _, text in added] == ["gallbladder"])


def test_programs_are_silent(bar, added):
    heard: list = []
    for signal in (bar.prompt_removed, bar.prompt_toggled, bar.prompt_recoloured, bar.threshold_changed, bar.decoder_changed):
        signal.connect(lambda *a: heard.append(a))
    row = bar.add_prompt("liver", QColor("#123456"), visible=False)
    bar.set_decoders([("rnse", "Regions", "by regions"), ("threshold", "Threshold", "")])
    bar.set_decoder("threshold")
    bar.set_threshold(0.3)
    assert bar.prompts()[0].colour == QColor("#123456")
    assert not bar.prompts()[0].visible
    bar.remove_prompt(row)
    bar.add_prompt("fat")
    bar.clear()
    assert bar.prompts() == []
    assert heard == []
    assert added == []


def test_eye_and_cross(bar):
    toggled: list = []
    removed: list = []
    bar.prompt_toggled.connect(lambda *a: toggled.append(a))
    bar.prompt_removed.connect(removed.append)
    one, two = bar.add_prompt("liver"), bar.add_prompt("fat")
    press(bar, "Hide fat")
    assert toggled == [(two, False)]
    assert [p.visible for p in bar.prompts()] == [True, False]
    press(bar, "Show fat")
    assert toggled[-1] == (two, True)
    press(bar, "Remove liver")
    assert removed == [one]
    assert [p.text for p in bar.prompts()] == ["fat"]
    assert bar.add_prompt("hook") not in (one, two)
    assert bar.prompts()[-1].colour == class_colour(0)  # free again


def test_a_hidden_prompt_typed_again_is_shown(bar, qtbot):
    toggled: list = []
    bar.prompt_toggled.connect(lambda *a: toggled.append(a))
    row = bar.add_prompt("fat", visible=False)
    field(bar).setText("fat")
    QTest.keyClick(field(bar), Qt.Key.Key_Return)
    qtbot.waitUntil(lambda: toggled == [(row, True)])


def test_recolour(bar):
    heard: list = []
    bar.prompt_recoloured.connect(lambda row, colour: heard.append((row, colour.name())))
    row = bar.add_prompt("liver")
    menu = bar.findChild(PromptRow)._swatch.menu()
    menu.actions()[4].trigger()
    assert heard == [(row, class_colour(4).name())]
    assert bar.prompts()[0].colour == class_colour(4)


def test_errors_are_said_and_taken_back(bar, qtbot):
    row = bar.add_prompt("splorg")

    def said():
        return any("“splorg” is not known." in label.text() and label.isVisible() for label in bar.findChildren(QLabel))

    row.set_error("“splorg” is not known.")
    qtbot.waitUntil(said)
    assert bar.prompts()[0].error
    row.set_error("")
    assert not said()


def test_threshold_and_decoder_by_hand(bar):
    thresholds: list = []
    decoders: list = []
    bar.threshold_changed.connect(thresholds.append)
    bar.decoder_changed.connect(decoders.append)
    bar.set_decoders([("rnse", "Regions", "by regions"), ("threshold", "Threshold", "")])
    assert bar.threshold() == pytest.approx(0.5)
    slider = bar.findChild(QSlider)
    QTest.keyClick(slider, Qt.Key.Key_Right)
    assert thresholds == [pytest.approx(0.51)]
    assert bar.threshold() == pytest.approx(0.51)
    QTest.keyClick(bar.findChild(QComboBox), Qt.Key.Key_Down)
    assert decoders == ["threshold"]
    assert bar.decoder() == "threshold"
    bar.set_threshold(7.0)
    assert bar.threshold() == 1.0
    with pytest.raises(ValueError, match="oracle"):
        bar.set_decoder("oracle")


def test_typing_reaches_no_shortcut(show, qtbot):
    """The window plays with Space and steps with arrows; while one types it must not."""
    window = QMainWindow()
    bar = PromptBar(window)
    window.setCentralWidget(bar)
    fired: list = []
    for key in ("Space", "Left", "Right", "Up", "Home", "M", "1", "[", "Ctrl+K"):
        action = QAction(window)
        action.setShortcut(QKeySequence(key))
        action.triggered.connect(lambda _=False, key=key: fired.append(key))
        window.addAction(action)
    show(window)
    bar.focus_input()
    qtbot.waitUntil(lambda: QApplication.focusWidget() is field(bar))
    assert consumes_key(QApplication.focusWidget())
    QTest.keyClicks(field(bar), "a M1[")
    for key in (Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_Up, Qt.Key.Key_Home):
        QTest.keyClick(field(bar), key)
    assert field(bar).text() == "a M1["
    assert fired == []
    QTest.keyClick(field(bar), Qt.Key.Key_K, Qt.KeyboardModifier.ControlModifier)
    assert fired == ["Ctrl+K"]
    slider = bar.findChild(QSlider)
    slider.setFocus()
    QTest.keyClick(slider, Qt.Key.Key_Right)
    assert fired == ["Ctrl+K"]
    QTest.keyClick(slider, Qt.Key.Key_Space)
    assert fired == ["Ctrl+K", "Space"]
