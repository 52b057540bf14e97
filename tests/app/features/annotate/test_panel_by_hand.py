"""Task: colours of classes, tools by their icons, how far a frame is, and labels from a file, by mouse and keys."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QHelpEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QComboBox, QFileDialog, QMenu, QToolTip

from degense.app.features.annotate.label_sets import write_labels
from degense.app.features.annotate.tool import TOOLS
from degense.engine.progress import finish
from degense.widgets.glyphs import GlyphButton
from degense.widgets.qt_images import to_array
from tests.app import installed as on
from tests.app.features.annotate.test_annotate import annotating, drag, labels  # noqa: F401
from tests.app.tasks.hands import Mouse

CONTROL, NONE = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.NoModifier
BLUE, ORANGE = (0x00, 0x72, 0xB2), (0xE6, 0x9F, 0x00)


def press(window, key: Qt.Key, held: Qt.KeyboardModifier = NONE) -> None:
    """A key from the window system, in the popup where there is one."""
    QTest.keyClick((QApplication.activePopupWidget() or window).windowHandle(), key, held)


def test_a_class_gets_another_colour(qtbot, annotating, run, idle, screenshot):  # noqa: F811
    """By the right mouse button, and by the menu's own keys; it is undone by name, and saved with the run."""
    window, state, listed = annotating, on.annotations(annotating), on.annotator(annotating).panel.classes
    hand, row = Mouse(window, idle, qtbot.waitUntil), listed.names.index("liver")
    came, before = state.work.classes[row].colour, on.viewer(window).panel.grab_image()
    mine = labels(window) == row
    place = listed.viewport().mapTo(window, listed.visualItemRect(listed.item(row)).center())
    QTest.mouseClick(window.windowHandle(), Qt.MouseButton.RightButton, NONE, place)
    screenshot(window, "class-colours")
    hand.pick("#0072b2")
    idle()
    assert state.work.classes[row].colour == BLUE != came
    assert window.session.undo.undo_name == "Colour of liver"
    changed = (on.viewer(window).panel.grab_image() != before).any(-1)
    assert changed[mine].mean() > 0.9
    assert not changed[~mine].any()
    icon = to_array(listed.item(row).icon().pixmap(listed.iconSize()).toImage())
    assert icon[1, 1, 2] > icon[1, 1, 0] + 40  # bluer than red
    QTest.mouseClick(window.windowHandle(), Qt.MouseButton.RightButton, NONE, place)
    qtbot.waitUntil(lambda: isinstance(QApplication.activePopupWidget(), QMenu))
    while QApplication.activePopupWidget().activeAction() is None or QApplication.activePopupWidget().activeAction().text() != "#e69f00":
        press(window, Qt.Key.Key_Down)
    press(window, Qt.Key.Key_Return)
    assert state.work.classes[row].colour == ORANGE
    on.viewer(window).panel.setFocus()
    press(window, Qt.Key.Key_Z, CONTROL)
    assert state.work.classes[row].colour == BLUE
    press(window, Qt.Key.Key_S, CONTROL)
    on.documents(window).open_path(run)
    idle()
    assert on.annotations(window).work.classes[row].colour == BLUE


def test_how_far_a_frame_is(qtbot, annotating, idle, screenshot):  # noqa: F811
    window, state = annotating, on.annotations(annotating)
    [box] = [found for found in on.annotator(window).panel.findChildren(QComboBox) if "review" in found.accessibleName()]
    assert box.currentText() == "open"
    press(window, Qt.Key.Key_D)
    assert (state.work.record(4).status, box.currentText()) == ("done", "done")
    press(window, Qt.Key.Key_Right)
    idle()
    assert (window.session.frame, box.currentText()) == (5, "open")
    Mouse(window, idle, qtbot.waitUntil).click(box)
    qtbot.waitUntil(box.view().isVisible)
    qtbot.wait(QApplication.doubleClickInterval() + 50)  # until then Qt takes a click for the second half of the first
    rows = box.view()
    qtbot.mouseClick(
        rows.viewport(), Qt.MouseButton.LeftButton, pos=rows.visualRect(rows.model().index(box.findText("flagged"), 0)).center()
    )
    assert (state.work.record(5).status, box.currentText()) == ("flagged", "flagged")
    qtbot.waitUntil(lambda: not box.view().isVisible())
    box.setFocus()
    press(window, Qt.Key.Key_Up)  # by keys too
    assert state.work.record(5).status == box.currentText() != "flagged"
    screenshot(window, "annotate-status")
    on.viewer(window).panel.setFocus()
    press(window, Qt.Key.Key_Left)
    idle()
    assert (window.session.frame, box.currentText()) == (4, "done")


def test_tools_have_icons_that_say_what_they_do(qtbot, annotating, idle):  # noqa: F811
    window, tool = annotating, on.annotations(annotating).tool
    buttons = {button.objectName(): button for button in on.annotator(window).panel.findChildren(GlyphButton) if button.isCheckable()}
    assert list(buttons) == [kind.name for kind in TOOLS] == ["brush", "eraser", "superpixels", "polygon", "fill", "wand"]
    hand, icons = Mouse(window, idle, qtbot.waitUntil), []
    for kind in TOOLS:
        button = buttons[kind.name]
        icons.append(to_array(button.grab().toImage()))
        assert np.ptp(icons[-1].astype(int).sum(-1)) > 200  # something is drawn
        middle = button.rect().center()
        QApplication.sendEvent(button, QHelpEvent(QEvent.Type.ToolTip, middle, button.mapToGlobal(middle)))
        assert QToolTip.text() == f"{kind.title} ({kind.key}): {kind.description}"
        assert kind.key in window.registry.keys(f"annotate.{kind.name}")
        hand.click(button)
        assert tool.name == kind.name
        assert [name for name, other in buttons.items() if other.isChecked()] == [kind.name]
    assert not any(np.array_equal(a, b) for place, a in enumerate(icons) for b in icons[:place])
    QToolTip.hideText()


@pytest.mark.parametrize(
    ("name", "title", "suffix"), [("coco", "From COCO (JSON, run lengths)", ".json"), ("masks-png", "From label maps (indexed PNG)", "")]
)
def test_labels_come_from_a_file(qtbot, annotating, idle, tmp_path, monkeypatch, name, title, suffix):  # noqa: F811
    """Annotate ▸ Import labels by mouse; of the system's dialog the answer alone is given. What is there is asked about first."""
    window, state, out = annotating, on.annotations(annotating), tmp_path / f"mine{suffix}"
    drag(qtbot, window, (20, 20), (50, 20))
    painted = labels(window).copy()
    finish(write_labels(name, state.snapshot(), out))
    press(window, Qt.Key.Key_Z, CONTROL)
    came = labels(window).copy()
    assert not np.array_equal(came, painted)
    asked: list[str] = []

    def answer(parent, asking: str, *rest: str):
        asked.append(asking)
        return (str(out), "") if suffix else str(out)

    monkeypatch.setattr(QFileDialog, "getOpenFileName" if suffix else "getExistingDirectory", answer)
    Mouse(window, idle, qtbot.waitUntil).choose("Annotate", "Import labels", title)
    idle()
    assert asked == [f"Import labels from {title.removeprefix('From ')}"]
    assert np.array_equal(labels(window), painted)
    assert window.session.undo.undo_name == f"Import mine{suffix}"
    assert window.statusBar().currentMessage() == f"mine{suffix}: label maps of 10 frames"
    on.viewer(window).panel.setFocus()
    press(window, Qt.Key.Key_Z, CONTROL)
    assert np.array_equal(labels(window), came)
