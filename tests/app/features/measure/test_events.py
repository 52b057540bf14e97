"""Task: mark what happens on the timeline, with a note."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit

from tests.app import installed as on


def write_note(window, text: str) -> None:
    editor = QApplication.focusWidget()
    assert isinstance(editor, QLineEdit)
    QTest.keyClicks(editor, text)
    QTest.keyClick(editor, Qt.Key.Key_Return)


def test_events_are_marked_noted_visited_and_saved(qtbot, opened, run, idle, screenshot):
    window, panel, events = opened, on.viewer(opened).panel, on.events(opened)
    panel.setFocus()
    for frame, note in ((6, "bleeding 1"), (2, "hook touches the gallbladder")):
        window.session.go_to(frame)
        panel.setFocus()
        QTest.keyClick(panel, Qt.Key.Key_E, Qt.KeyboardModifier.ShiftModifier)
        write_note(window, note)
        qtbot.waitUntil(lambda frame=frame, note=note: events.state.notes[frame] == note)
    assert events.state.notes == {2: "hook touches the gallbladder", 6: "bleeding 1"}
    assert [events.table.item(row, 0).text() for row in range(2)] == ["2", "6"]
    screenshot(window, "events")
    panel.setFocus()
    QTest.keyClick(panel, Qt.Key.Key_Home)
    for key, frame in ((Qt.Key.Key_Right, 2), (Qt.Key.Key_Right, 6), (Qt.Key.Key_Left, 2)):
        QTest.keyClick(panel, key, Qt.KeyboardModifier.AltModifier)
        assert window.session.frame == frame
    assert not window.registry["events.previous"].enabled()
    cell = events.table.visualItemRect(events.table.item(1, 0)).center()
    QTest.mouseClick(events.table.viewport(), Qt.MouseButton.LeftButton, pos=cell)
    assert window.session.frame == 6
    assert not window.registry["events.next"].enabled()
    QTest.mouseClick(events.remove_button, Qt.MouseButton.LeftButton)
    assert list(events.state.notes) == [2]
    window.registry.run("edit.undo")
    assert window.session.undo.redo_name == "Remove the event in frame 6"
    window.registry.run("file.save")
    on.documents(window).open_path(run)
    idle()
    assert events.state.notes == {2: "hook touches the gallbladder", 6: "bleeding 1"}
    assert on.time(window).timeline.track._events == events.state.notes
