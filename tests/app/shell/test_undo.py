"""Take back what was done, and go to any point of the history."""

from __future__ import annotations

from PySide6.QtCore import Qt

from tests.app import installed as on


def test_the_history_names_every_edit_and_a_click_goes_there(qtbot, opened, idle, screenshot):
    session, history = opened.session, on.dock(opened, "History").widget()
    session.view.set_layer("depth")
    session.view.add_prompt("liver")
    session.go_to(4)  # the instant is no edit, and does not end the history
    session.view.set_layer("mask")
    idle()
    opened.registry.run("edit.history")
    session.view.set_threshold(0.25)
    texts = [history.item(row).text() for row in range(history.count())]
    assert texts == ["As opened", "Prompt liver", "Mask threshold"]  # the layer that is looked at is no edit either
    place = history.visualItemRect(history.item(1)).center()
    qtbot.mouseClick(history.viewport(), Qt.MouseButton.LeftButton, pos=place)
    idle()
    assert (session.view_state.layer, session.view_state.threshold, session.frame) == ("mask", 0.5, 4)
    entries = [history.item(row) for row in range(history.count())]
    assert [entry.text() for entry in entries if entry.font().italic()] == [
        "Mask threshold",
    ]
    screenshot(opened, "history")
    qtbot.keyClick(opened, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier)
    assert session.view_state.threshold == 0.25
    assert history.currentRow() == 2
