"""What the mouse does in dialogs, lists, prompts and panels, done by keys that the window system sends."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QLineEdit, QPushButton, QStyle, QStyleOptionViewItem

from degense.app.features.export.label_dialog import LabelExportDialog
from tests.app import installed as on

CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier
#: Those that show and hide the first, the second, … prompt.
PROMPT_KEYS = (
    *("prompts.show-1", "prompts.show-2", "prompts.show-3", "prompts.show-4", "prompts.show-5"),
    *("prompts.show-6", "prompts.show-7", "prompts.show-8", "prompts.show-9"),
)
ALT, NONE = Qt.KeyboardModifier.AltModifier, Qt.KeyboardModifier.NoModifier


def key(which: Qt.Key, held: Qt.KeyboardModifier = NONE) -> None:
    """Press a key in the window that has the keyboard, by way of shortcuts and popups."""
    top = QApplication.activePopupWidget() or QApplication.activeModalWidget() or QApplication.activeWindow()
    QTest.keyClick(top.windowHandle(), which, held)


def type_text(text: str) -> None:
    for letter in text:
        top = QApplication.activePopupWidget() or QApplication.activeWindow()
        QTest.keyClick(top.windowHandle(), letter)


def click(widget, where: QPoint, *, twice: bool = False) -> None:
    send = QTest.mouseDClick if twice else QTest.mouseClick
    send(widget.window().windowHandle(), Qt.MouseButton.LeftButton, NONE, widget.mapTo(widget.window(), where))


def in_front(qtbot, dialog: QDialog) -> None:
    """Give a dialog the keyboard, as a window manager does, of which there is none here."""
    dialog.activateWindow()
    qtbot.waitUntil(dialog.isActiveWindow)


def test_enter_exports(qtbot, opened, idle, tmp_path):
    key(Qt.Key.Key_E, CONTROL | ALT)
    dialog = opened.findChild(LabelExportDialog)
    in_front(qtbot, dialog)
    dialog.path.line.setFocus()
    dialog.path.line.selectAll()
    type_text(str(tmp_path / "masks"))
    key(Qt.Key.Key_Return)
    idle()
    assert (tmp_path / "masks").exists()
    assert opened.statusBar().currentMessage().startswith(f"Saved {tmp_path / 'masks'}")


@pytest.mark.parametrize(("action", "button"), [("export.movie", "Save…"), ("file.search", "Search"), ("train.start", "Start")])
def test_enter_does_what_a_dialog_is_for(qtbot, opened, action, button):
    opened.registry.run(action)
    [dialog] = [dialog for dialog in opened.findChildren(QDialog) if dialog.isVisible()]
    in_front(qtbot, dialog)
    dialog.findChild(QLineEdit).setFocus()
    assert [found.text() for found in dialog.findChildren(QPushButton) if found.isDefault()] == [button]
    dialog.reject()


def test_the_box_of_a_layer_can_be_clicked_again_and_again(opened, idle):
    """Each click lays the rows anew before Qt says which was clicked, and then it knows none."""
    rows = on.layers(opened).layers.rows

    def box() -> QPoint:
        index, option = rows.model().index(rows.names().index("depth"), 0), QStyleOptionViewItem()
        rows.initViewItemOption(option)
        option.rect = rows.visualRect(index)
        option.features |= QStyleOptionViewItem.ViewItemFeature.HasCheckIndicator
        return rows.style().subElementRect(QStyle.SubElement.SE_ItemViewItemCheckIndicator, option, rows).center()

    def shown() -> list[str]:
        return [blend.name for blend in opened.session.view_state.drawn]

    click(rows.viewport(), box())
    assert shown() == ["rgb", "depth"]
    click(rows.viewport(), box())
    assert shown() == ["rgb"]
    click(rows.viewport(), box(), twice=True)  # on and off again
    idle()
    assert shown() == ["rgb"]


def test_a_slash_is_typed_into_the_field_that_a_slash_opens(qtbot, opened):
    on.viewer(opened).panel.setFocus()
    key(Qt.Key.Key_Slash)
    field = QApplication.focusWidget()
    assert isinstance(field, QLineEdit)
    type_text("gall")
    qtbot.waitUntil(lambda: QApplication.activePopupWidget() is not None)  # the completer's list
    type_text("/b/")
    assert field.text() == "gall/b/"
    assert field.selectedText() == ""
    key(Qt.Key.Key_Slash, SHIFT)  # where it stands on a German keyboard
    assert field.text() == "gall/b//"


def prompted(opened, idle, *texts: str) -> None:
    for text in texts:
        opened.session.view.add_prompt(text)
    idle()


def texts(opened) -> list[str]:
    return [prompt.text for prompt in opened.session.view_state.prompts]


def test_a_prompt_gets_other_words_by_keys(opened, idle):
    prompted(opened, idle, "liver", "grasper")
    on.prompts(opened).focus()
    for _ in range(20):
        key(Qt.Key.Key_Tab)
        if QApplication.focusWidget().accessibleName() == "Prompt liver":
            break
    key(Qt.Key.Key_F2)
    type_text("gallbladder")  # the old words are selected
    key(Qt.Key.Key_Return)
    idle()
    assert texts(opened) == ["gallbladder", "grasper"]
    assert QApplication.focusWidget().accessibleName() == "Prompt gallbladder"
    assert opened.menus.actions["edit.undo"].text() == "Undo: Prompt gallbladder in place of liver"
    key(Qt.Key.Key_F2)
    type_text("xyzzy")
    key(Qt.Key.Key_Escape)  # leaves the words; it follows nothing elsewhere
    assert texts(opened) == ["gallbladder", "grasper"]
    key(Qt.Key.Key_F2)
    type_text("not fat")
    key(Qt.Key.Key_Return)
    idle()
    assert [(prompt.text, prompt.negative) for prompt in opened.session.view_state.prompts] == [("fat", True), ("grasper", False)]


def test_a_prompt_gets_other_words_by_mouse(opened, idle, screenshot):
    prompted(opened, idle, "liver", "grasper")
    name = on.prompts(opened).bar.prompts()[0].name
    click(name, name.rect().center(), twice=True)
    screenshot(opened, "prompt-renamed")
    type_text("grasper")
    field = on.viewer(opened).panel
    field.setFocus()  # as by a click: what was typed is taken
    idle()
    assert texts(opened) == ["liver", "grasper"]
    assert "already in the list" in " ".join(
        label.text() for label in on.prompts(opened).bar.prompts()[0].findChildren(type(name).__base__)
    )


def test_prompts_have_keys_that_show_and_hide_them(opened, idle):
    assert [opened.registry.keys(action) for action in PROMPT_KEYS] == [(f"Alt+{number}",) for number in range(1, 10)]
    prompted(opened, idle, "liver", "grasper")
    key(Qt.Key.Key_2, ALT)
    assert [prompt.visible for prompt in opened.session.view_state.prompts] == [True, False]
    key(Qt.Key.Key_2, ALT)
    key(Qt.Key.Key_3, ALT)  # there is no third
    assert [prompt.visible for prompt in opened.session.view_state.prompts] == [True, True]
    opened.registry.rebind({"prompts.show-1": ("Ctrl+Alt+L",)})
    opened.menus.rebind()
    key(Qt.Key.Key_L, CONTROL | ALT)
    idle()
    assert [prompt.visible for prompt in opened.session.view_state.prompts] == [False, True]


def test_a_key_goes_from_part_to_part(opened, idle, qtbot):
    def part() -> str:
        widget = QApplication.focusWidget()
        while widget is not None:
            if widget.objectName() in ("Prompts", "Layers", "History"):
                return widget.objectName()
            widget = widget.parentWidget()
        return "else"

    prompted(opened, idle, "liver")
    on.viewer(opened).panel.setFocus()
    seen = []
    for _ in range(6):
        key(Qt.Key.Key_F6)
        seen.append(part())
    assert {"Prompts", "Layers", "else"} <= set(seen)
    on.prompts(opened).focus()
    key(Qt.Key.Key_F6, SHIFT)
    assert part() != "Prompts"
    key(Qt.Key.Key_F6)
    assert part() == "Prompts"
    assert isinstance(QApplication.focusWidget(), QLineEdit)  # where the keyboard was last
    key(Qt.Key.Key_H, CONTROL)
    assert part() == "History"
    key(Qt.Key.Key_Home)
    key(Qt.Key.Key_Return)
    assert texts(opened) == []
