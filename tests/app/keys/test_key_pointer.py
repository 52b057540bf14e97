"""Painting, placing points, measuring and clicking by keyboard alone, with keys that the window system sends."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QContextMenuEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from degense.app.features.annotate.class_list import ClassList
from degense.app.session.targets import Spot
from tests.app import installed as on

SHIFT, NONE = Qt.KeyboardModifier.ShiftModifier, Qt.KeyboardModifier.NoModifier
RIGHT, LEFT, UP, DOWN = Qt.Key.Key_Right, Qt.Key.Key_Left, Qt.Key.Key_Up, Qt.Key.Key_Down


@pytest.fixture
def keys(opened, idle):
    """Press keys in the window with the tiny run at frame 4; its 2D view has the keyboard."""
    opened.session.go_to(4)
    idle()
    on.viewer(opened).panel.setFocus()

    def press(*which: Qt.Key, held: Qt.KeyboardModifier = NONE) -> None:
        for key in which:
            QTest.keyClick(opened.windowHandle(), key, held)
        idle()

    return press


def go(keys, window, x: int, y: int) -> None:
    """Move the pointer to a pixel with the arrows, and with Shift where it is far."""
    for _ in range(100):
        at = on.pointer(window).at
        here = int(at.x()), int(at.y())
        if here == (x, y):
            return
        for now, wanted, less, more in ((here[0], x, LEFT, RIGHT), (here[1], y, UP, DOWN)):
            if now != wanted:
                keys(more if wanted > now else less, held=SHIFT if abs(wanted - now) >= 10 else NONE)
    raise AssertionError(f"the pointer never came to {x}, {y}")


def test_a_stroke_is_painted(opened, keys, idle, screenshot):
    window = opened
    state = on.annotations(window)
    keys(Qt.Key.Key_A, Qt.Key.Key_7, Qt.Key.Key_Z)
    state.tool.choose(radius=3.0)
    before = state.labels(4).copy()
    frame = window.session.frame
    go(keys, window, 20, 60)
    keys(Qt.Key.Key_Return)  # the button goes down
    go(keys, window, 50, 60)
    screenshot(window, "key-pointer-paint")
    keys(Qt.Key.Key_Return)
    painted = state.labels(4) == 6
    assert painted[60, 20:50].all()
    assert not (painted & (before != 6))[:50].any()
    go(keys, window, 50, 30)  # nothing more is painted
    assert np.array_equal(state.labels(4) == 6, painted)
    assert window.session.frame == frame  # the arrows were the pointer's
    assert window.menus.actions["edit.undo"].text() == "Undo: Paint in frame 4"
    QTest.keyPress(window.windowHandle(), Qt.Key.Key_Space)  # held while the pointer moves: a drag
    QTest.keyClick(window.windowHandle(), DOWN)
    QTest.keyRelease(window.windowHandle(), Qt.Key.Key_Space)
    idle()
    assert (state.labels(4) == 6)[31, 50]
    keys(Qt.Key.Key_Escape, RIGHT)
    assert not on.pointer(window).on
    assert window.session.frame == frame + 1


def test_a_point_is_placed_and_corrected(opened, keys, screenshot):
    window = opened
    keys(Qt.Key.Key_T, Qt.Key.Key_Z)
    on.viewer(window).panel.setFocus()
    go(keys, window, 40, 30)
    keys(Qt.Key.Key_Space)
    [point] = on.tracking(window).state.points
    assert np.allclose(point.queries, ((4, 40.5, 30.5),))
    screenshot(window, "key-pointer-track")


def test_a_distance_is_measured(opened, keys, screenshot):
    window = opened
    keys(Qt.Key.Key_D, held=SHIFT)
    keys(Qt.Key.Key_Z)
    for corner in ((30, 30), (60, 45)):
        go(keys, window, *corner)
        keys(Qt.Key.Key_Space)
    [measure] = on.measuring(window).state.measures
    assert np.allclose(measure.corners, ((30.5, 30.5), (60.5, 45.5)))
    assert on.measuring(window).quantities()[0].values[4] > 0
    screenshot(window, "key-pointer-measure")


def test_a_place_is_probed(opened, keys):
    window = opened
    keys(Qt.Key.Key_Z)
    go(keys, window, 45, 35)
    keys(Qt.Key.Key_Space)
    assert isinstance(window.session.probe, Spot)
    assert (int(window.session.probe.x), int(window.session.probe.y), window.session.probe.frame) == (45, 35, 4)


def test_an_area_is_closed_by_enter(opened, keys):
    window = opened
    keys(Qt.Key.Key_A, held=SHIFT)
    keys(Qt.Key.Key_Z)
    for corner in ((40, 20), (65, 20), (65, 45)):
        go(keys, window, *corner)
        keys(Qt.Key.Key_Space)
    keys(Qt.Key.Key_Return)
    assert len(on.measuring(window).state.measures[0].corners) == 3
    assert not on.pointer(window).held


def test_the_pointer_stays_in_the_frame_and_in_sight(opened, keys, qtbot):
    window, panel = opened, on.viewer(opened).panel
    keys(Qt.Key.Key_Z)
    panel.zoom.set_factor(4 * panel.zoom.factor())
    for _ in range(12):
        keys(LEFT, UP, held=SHIFT)
    assert (on.pointer(window).at.x(), on.pointer(window).at.y()) == (0.5, 0.5)
    assert panel.rect().contains(panel.zoom.to_widget(on.pointer(window).at).toPoint())
    keys(Qt.Key.Key_Z, Qt.Key.Key_Z)  # it is where it was
    assert on.pointer(window).at.x() == 0.5
    QTest.keyClick(window.windowHandle(), Qt.Key.Key_F6)  # elsewhere the arrows are not its own
    assert on.pointer(window).on
    QTest.keyClick(window.windowHandle(), RIGHT)
    assert on.pointer(window).at.x() == 0.5


def test_the_menu_of_a_class_by_its_key(opened, keys):
    """Its colour, its name and another object of it are there."""
    keys(Qt.Key.Key_A)
    listed = on.annotator(opened).panel.findChild(ClassList)
    listed.setFocus()
    listed.setCurrentRow(2)
    name = listed.names[2]
    middle = listed.viewport().rect().center()  # where Qt says that the key was pressed
    event = QContextMenuEvent(QContextMenuEvent.Reason.Keyboard, middle, listed.viewport().mapToGlobal(middle))
    QApplication.sendEvent(listed.viewport(), event)
    menu = QApplication.activePopupWidget()
    assert menu is not None
    assert f"Another {name}, as an object of its own" in [action.text() for action in menu.actions()]
    menu.close()
