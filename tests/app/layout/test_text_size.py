"""Text of other sizes: nothing is cut at 200 %."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtGui import QScreen
from PySide6.QtWidgets import QAbstractButton, QDialog, QLabel, QScrollArea, QTableWidget, QTabWidget, QWidget

from degense.app.features.welcome.page import WelcomePage
from degense.widgets.qt_images import to_array
from degense.widgets.theme import apply_text_size
from tests.app import installed as on


@pytest.fixture
def usual_size(qapp):
    yield
    apply_text_size(qapp, 1.0)


def cut(window: QWidget) -> list[str]:
    """Texts that are wider or higher than what shows them. Some labels give their tooltip where there is no room."""
    found = []
    for widget in window.findChildren(QWidget):
        if not widget.isVisible() or not isinstance(widget, QLabel | QAbstractButton) or not widget.text() or widget.minimumWidth() == 1:
            continue
        metrics, lines = widget.fontMetrics(), widget.text().splitlines()
        wraps = isinstance(widget, QLabel) and widget.wordWrap()
        if isinstance(widget, QLabel) and widget.textFormat() == Qt.TextFormat.RichText:
            continue
        width = max(metrics.horizontalAdvance(line.replace("&", "")) for line in lines)
        if (width > widget.width() + 1 and not wraps and widget.toolTip() != widget.text()) or metrics.height() > widget.height() + 2:
            found.append(f"{widget.text()!r} in {type(widget).__name__}, {widget.width()} × {widget.height()}")
    return found


def height_of_title(window: QWidget) -> int:
    """Rows of pixels that the title of a panel takes."""
    dock = on.dock(window, "Layers")
    image = to_array(dock.grab().toImage())[: dock.widget().y(), : dock.width() // 2]
    return int((np.ptp(image[..., 0], axis=1) > 60).sum())


def title_buttons(window: QWidget) -> list[QRect]:
    """Where the buttons in the title of a panel are, from the left."""
    dock = on.dock(window, "Layers")
    found = [dock.findChild(QAbstractButton, f"qt_dockwidget_{name}button") for name in ("float", "close")]
    return [button.geometry() for button in found]


def test_larger_text_by_keys(qtbot, opened, qapp, usual_size, idle, screenshot):
    before, title, buttons = opened.fontMetrics().height(), height_of_title(opened), title_buttons(opened)
    opened.session.view.add_prompt("liver")
    opened.session.view.set_layer("displacement")
    idle()
    for _ in range(7):
        qtbot.keyClick(opened, Qt.Key.Key_Equal, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier)
    qtbot.wait(50)
    assert opened.settings.value.text_size == 2.0
    assert on.layers(opened).layers.rows.fontMetrics().height() >= 1.9 * before
    opened.resize(1600, 1000)
    qtbot.wait(50)
    screenshot(opened, "text-200")
    assert height_of_title(opened) >= 1.6 * title
    large = title_buttons(opened)
    assert all(after.height() >= 1.6 * usual.height() for usual, after in zip(buttons, large, strict=True))
    assert large[0].right() < large[1].left()
    assert max(button.bottom() for button in large) < on.dock(opened, "Layers").widget().y()
    assert not cut(opened)
    opened.docks.bring(on.dock(opened, "Curves"))
    qtbot.wait(50)
    assert not cut(opened)
    qtbot.keyClick(opened, Qt.Key.Key_Minus, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier)
    assert opened.settings.value.text_size == 1.8
    opened.registry.run("text.usual")
    assert opened.settings.value.text_size == 1.0
    qtbot.waitUntil(lambda: opened.fontMetrics().height() == before)
    qtbot.waitUntil(lambda: title_buttons(opened) == buttons)


DIALOGS = (
    *("export.labels", "export.movie", "export.report", "file.share", "train.start", "train.runs", "file.search", "edit.preferences"),
    *("help.keys", "help.layers"),
)


@pytest.fixture
def small_screen(monkeypatch):
    """As if the screen were one of 1024 × 700."""
    monkeypatch.setattr(QScreen, "availableSize", lambda screen: QSize(1024, 700))
    return QSize(1024, 700)


def look_at(dialog: QDialog, screen: QSize) -> None:
    assert not cut(dialog)
    least = dialog.minimumSizeHint()
    assert max(dialog.width(), least.width()) <= screen.width(), least
    assert max(dialog.height(), least.height()) <= screen.height(), least


@pytest.mark.parametrize("action", DIALOGS)
def test_dialogs_at_twice_the_size(qtbot, opened, qapp, usual_size, small_screen, action, screenshot):
    """They fit the screen, and nothing in them is cut."""
    apply_text_size(qapp, 2.0)
    opened.registry.run(action)
    [dialog] = [dialog for dialog in opened.findChildren(QDialog) if dialog.isVisible()]
    screenshot(dialog, f"dialog-200-{action}")
    look_at(dialog, small_screen)
    dialog.reject()


def test_the_check_of_a_clip_at_twice_the_size(qtbot, window, tiny_clip, qapp, idle, usual_size, small_screen, screenshot):
    on.documents(window).open_path(tiny_clip)
    idle()
    apply_text_size(qapp, 2.0)
    window.registry.run("file.check")
    idle()
    [dialog] = [dialog for dialog in window.findChildren(QDialog) if dialog.isVisible()]
    screenshot(dialog, "dialog-200-check")
    look_at(dialog, small_screen)
    area = dialog.findChild(QScrollArea)
    assert area.widget().minimumSizeHint().width() <= area.viewport().width()
    dialog.reject()


def test_the_welcome_page_at_twice_the_size(qtbot, window, qapp, usual_size, screenshot):
    usual = window.fontMetrics().height()
    apply_text_size(qapp, 2.0)
    window.resize(1600, 1000)
    qtbot.wait(50)
    screenshot(window, "welcome-200")
    assert not cut(window)
    link = on.found(window, WelcomePage).ways[0]
    assert link.height() >= 2 * link.fontMetrics().height() >= 4 * 0.9 * usual


@pytest.mark.parametrize("size", [(1440, 900), (1024, 700)])
def test_the_annotation_panel_at_twice_the_size(qtbot, opened, qapp, usual_size, idle, size, screenshot):
    apply_text_size(qapp, 2.0)
    opened.resize(*size)
    opened.registry.run("annotate.mode")
    idle()
    panel = on.annotator(opened).panel
    pages = panel.findChild(QTabWidget)
    for index in range(pages.count()):
        pages.setCurrentIndex(index)
        qtbot.wait(50)
        screenshot(opened, f"annotation-200-{size[0]}-{pages.tabText(index).lower()}")
        assert not cut(panel), pages.tabText(index)
        table = pages.currentWidget().findChild(QTableWidget)
        assert table is None or table.verticalHeader().defaultSectionSize() >= table.fontMetrics().height()
    assert opened.width() == size[0]
