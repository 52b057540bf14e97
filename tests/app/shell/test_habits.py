"""Every action can be found, done and reached by keys; no key is stolen from who is typing; every control has a name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QComboBox,
    QDialog,
    QFileDialog,
    QKeySequenceEdit,
    QLineEdit,
    QPlainTextEdit,
    QProgressBar,
    QTabBar,
    QTextEdit,
    QWidget,
)

CONTROLS = (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSlider,
    QAbstractSpinBox,
    QComboBox,
    QLineEdit,
    QPlainTextEdit,
    QProgressBar,
    QTextEdit,
)


def above(control: QWidget) -> Iterator[QWidget]:
    while (control := control.parent()) is not None:
        yield control


def nameless(window: QWidget) -> list[str]:
    """Controls that a screen reader would call nothing. The insides of compound controls speak through these."""
    compound = (QComboBox, QAbstractSpinBox, QLineEdit, QAbstractItemView, QTabBar, QKeySequenceEdit)
    return [
        " in ".join(type(widget).__name__ for widget in (control, *above(control)))
        for control in window.findChildren(QWidget)
        if isinstance(control, CONTROLS)
        and not (control.accessibleName() or (isinstance(control, QAbstractButton) and control.text()))
        and not any(isinstance(widget, compound) for widget in above(control))
        and not any(widget.objectName().startswith("qt_") for widget in (control, control.parent()))
    ]


def dialogs(window: QWidget) -> list[QDialog]:
    return [dialog for dialog in window.findChildren(QDialog) if dialog.isVisible()]


def test_every_action_is_found_and_does_something(opened, idle, monkeypatch):
    """Each is triggered from a state in which its task can begin; none may complain. Others are named in a test of their task."""
    for name in ("getOpenFileName", "getSaveFileName"):
        monkeypatch.setattr(QFileDialog, name, lambda *args, **more: ("", ""))
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *args, **more: "")
    monkeypatch.setattr("degense.app.diagnostics.report", lambda: ("all is well", True))
    leaving = ("file.demo", "file.check", "file.close", "file.quit")
    order = [action.id for action in opened.registry if action.id not in leaving and not action.id.startswith("prompts.show-")]
    done = set()
    for layer, ids in (("mask", order), ("displacement", order), ("rgb", ["file.demo"])):
        if not opened.session.view_state.prompts:
            opened.session.view.add_prompt("liver")
        opened.session.view.set_layer(layer)
        opened.registry.run("cameras.add")
        idle()
        for action_id in ids:
            if action_id in done or not opened.registry[action_id].enabled():
                continue
            opened.menus.actions[action_id].trigger()
            idle()
            done.add(action_id)
            for dialog in dialogs(opened):
                assert dialog.objectName() != "error", f"{action_id}: {dialog.text()}"
                assert not nameless(dialog), f"{action_id}: {nameless(dialog)}"
                dialog.close()
    others = "".join(file.read_text(encoding="utf-8") for file in Path(__file__).parents[1].rglob("*.py") if file != Path(__file__))
    untested = {action.id for action in opened.registry if action.id not in done and f'"{action.id}"' not in others}
    assert not untested


def test_every_control_of_the_window_has_a_name(opened):
    assert not nameless(opened), "\n".join(nameless(opened))


def test_no_key_is_stolen_from_who_is_typing(qtbot, opened, idle):
    """Every shortcut without Ctrl or Alt is pressed in every text field that a user can get into."""
    keys = {QKeySequence(key)[0] for action in opened.registry for key in opened.registry.keys(action.id)}
    plain = [key for key in keys if not key.keyboardModifiers() & (Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier)]
    typed = [key for key in plain if not Qt.Key.Key_F1 <= key.key() <= Qt.Key.Key_F35 and key.key() != Qt.Key.Key_Escape]
    assert len(typed) > 15
    fired: list[str] = []
    for action_id, action in opened.menus.actions.items():
        action.triggered.connect(lambda *args, action_id=action_id: fired.append(action_id))
    opened.session.view.set_layer("depth")
    idle()
    opened.activateWindow()
    qtbot.waitUntil(opened.isActiveWindow)
    fields = [
        field
        for field in opened.findChildren(QWidget)
        if isinstance(field, QLineEdit | QAbstractSpinBox | QPlainTextEdit | QTextEdit)
        and field.isVisible()
        and field.isEnabled()
        and not getattr(field, "isReadOnly", lambda: False)()
    ]
    assert len(fields) >= 3
    for field in fields:
        field.setFocus()
        for key in typed:
            QTest.keyClick(field, key.key(), key.keyboardModifiers())
        assert fired == [], f"stolen from {field.accessibleName() or type(field).__name__}"
