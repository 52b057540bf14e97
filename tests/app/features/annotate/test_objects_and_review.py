"""Task: two graspers, a mask taken as label, doubtful frames one after the other, and how often each class is labelled."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QContextMenuEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMenu, QTabWidget

from degense.engine.annotation.annotations import Record
from degense.engine.annotation.edits import Proposal, pack
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet
from tests.app import installed as on
from tests.app.features.annotate.test_annotate import annotating, at, drag, labels  # noqa: F401


def open_page(window, title: str) -> QTabWidget:
    pages = on.annotator(window).panel.findChild(QTabWidget)
    index = next(i for i in range(pages.count()) if pages.tabText(i) == title)
    QTest.mouseClick(pages.tabBar(), Qt.MouseButton.LeftButton, pos=pages.tabBar().tabRect(index).center())
    return pages


def test_another_grasper_is_an_object_of_the_same_class(qtbot, annotating, idle, screenshot):  # noqa: F811
    window, state, classes = annotating, on.annotations(annotating), on.annotator(annotating).panel.classes
    row = classes.names.index("grasper")
    place = classes.visualItemRect(classes.item(row)).center()
    event = QContextMenuEvent(QContextMenuEvent.Reason.Mouse, place, classes.viewport().mapToGlobal(place))
    QApplication.sendEvent(classes.viewport(), event)
    menu = next(menu for menu in classes.findChildren(QMenu) if menu.isVisible())
    action = next(action for action in menu.actions() if action.text().startswith("Another grasper"))
    QTest.mouseClick(menu, Qt.MouseButton.LeftButton, pos=menu.actionGeometry(action).center())
    assert classes.names[-1] == "grasper 2"
    assert state.tool.label == len(classes.names) - 1
    drag(qtbot, window, (20, 20), (50, 20))
    assert (labels(window)[20, 20:50] == len(classes.names) - 1).all()
    classes.item(row).setText("forceps")
    assert [classes.names[row], classes.names[-1]] == ["forceps", "forceps 2"]
    assert state.work.classes[row].name == state.work.classes[-1].name == "forceps"
    assert len(state.snapshot().by_class().classes) == len(classes.names) - 1
    screenshot(window, "annotate-objects")
    for _ in range(3):
        window.registry.run("edit.undo")
    assert classes.names == list(window.session.scene.classes)


def test_the_wand_takes_the_mask_under_the_click(qtbot, annotating, idle):  # noqa: F811
    window, panel, state = annotating, on.viewer(annotating).panel, on.annotations(annotating)
    qtbot.keyClick(panel, Qt.Key.Key_W)
    qtbot.mouseClick(panel, Qt.MouseButton.LeftButton, pos=at(window, 50, 40))
    assert window.statusBar().currentMessage().startswith("Prompt something first")
    window.session.view.add_prompt("gallbladder")
    idle()
    mask = decode_frame(window.session.scene, PromptSet(("gallbladder",)), 4).masks[0]
    rows, columns = np.nonzero(mask)
    qtbot.keyClick(panel, Qt.Key.Key_6)
    middle = len(rows) // 2
    qtbot.mouseClick(panel, Qt.MouseButton.LeftButton, pos=at(window, columns[middle] + 0.5, rows[middle] + 0.5))
    idle()
    taken = labels(window) == 5
    assert window.session.undo.undo_name == "Mask of gallbladder in frame 4"
    assert taken[rows[middle], columns[middle]]
    assert (taken & mask).sum() > 0.5 * mask.sum()
    assert not (taken & ~mask & (state.work.original(4) != 5)).any()


def test_doubtful_frames_are_stepped_through_by_doubt(qtbot, annotating, idle, screenshot):  # noqa: F811
    window, panel, state = annotating, on.viewer(annotating).panel, on.annotations(annotating)
    size = state.work.shape
    some = pack(np.zeros(size, np.uint8))
    for frame, confidence in ((1, 0.6), (2, 0.9), (6, 0.2), (8, 0.5)):
        state.work.records[frame] = Record(proposal=Proposal(some, size, confidence))
    state.records_changed.emit()
    visited = []
    for key in (Qt.Key.Key_N, Qt.Key.Key_N, Qt.Key.Key_N, Qt.Key.Key_N, Qt.Key.Key_P):
        qtbot.keyClick(panel, key)
        visited.append(window.session.frame)
    assert visited == [6, 8, 1, 6, 1]
    open_page(window, "Review")
    idle()
    screenshot(window, "annotate-queue")
    table = on.annotator(window).panel.queue.table
    assert [table.item(row, 0).text() for row in range(table.rowCount())] == ["6", "8", "1"]
    assert [table.item(row, 1).text() for row in range(3)] == ["80%", "50%", "40%"]
    assert table.currentRow() == 2
    QTest.mouseClick(table.viewport(), Qt.MouseButton.LeftButton, pos=table.visualItemRect(table.item(1, 0)).center())
    assert window.session.frame == 8
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_Y)  # accepted: it leaves the queue
    assert state.work.review_queue() == [6, 1]
    qtbot.keyClick(panel, Qt.Key.Key_N)
    assert window.session.frame == 6


def test_statistics_follow_what_is_painted(qtbot, annotating, idle, screenshot):  # noqa: F811
    window, state = annotating, on.annotations(annotating)
    open_page(window, "Statistics")
    idle()
    table = on.annotator(window).panel.statistics.table
    names, clip = [kind.name for kind in state.work.classes], window.session.clip
    came = np.stack([clip.labels(frame) for frame in range(10)])
    pixels = [int((came == index).sum()) for index in range(len(names))]
    assert [table.item(row, 0).text() for row in range(table.rowCount())] == names
    assert [table.item(row, 2).text() for row in range(table.rowCount())] == [f"{count:,}" for count in pixels]
    assert [table.item(row, 1).text() for row in range(table.rowCount())] == [str((came == i).any((1, 2)).sum()) for i in range(len(names))]
    screenshot(window, "annotate-statistics")
    qtbot.keyClick(on.viewer(window).panel, Qt.Key.Key_7)
    drag(qtbot, window, (20, 20), (50, 20))
    idle()
    painted = int((np.stack([state.labels(frame) for frame in range(10)]) == 6).sum())
    assert painted > pixels[6]
    assert table.item(6, 2).text() == f"{painted:,}"
