"""Task: settle theme, saving and keys; the settings hold at once and at the next start."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QTextBrowser

from degense.app.application import FEATURES
from degense.app.features.preferences.controller import PreferencesDialog
from degense.app.shell.settings import SettingsFile
from degense.app.shell.shell import Shell
from degense.widgets.theme import apply_theme, is_dark
from tests.app import installed as on


@pytest.fixture
def preferences(window, qapp) -> PreferencesDialog:
    window.registry.run("edit.preferences")
    yield window.findChild(PreferencesDialog)
    apply_theme(qapp, "dark")


def test_settings_hold_at_once_and_are_remembered(qtbot, window, preferences, qapp, screenshot):
    screenshot(window, "preferences-dark")
    preferences.theme.setCurrentIndex(1)
    assert not is_dark(qapp.palette())
    assert window.menus.actions["theme.light"].isChecked()
    preferences.autosave.setValue(5)
    preferences.undo.setValue(64)
    screenshot(window, "preferences-light")
    value = SettingsFile(window.settings.path).value
    assert (value.theme, value.autosave, value.undo_memory) == ("light", 5.0, 64.0)
    for value in range(10):
        window.session.undo.record("paint", print, value, value, size=10 << 20)
    assert window.session.undo.size == 60 << 20
    preferences.close()


def test_what_was_settled_can_be_undone(window, qapp):
    for theme in ("light", "dark", "light"):
        window.registry.run(f"theme.{theme}")
    assert window.session.undo.entries == ("Theme",)  # in quick succession: one step
    window.registry.run("edit.undo")
    assert is_dark(qapp.palette())
    assert window.settings.value.theme == "dark"
    window.registry.run("edit.redo")
    assert not is_dark(qapp.palette())
    window.registry.run("theme.dark")


def test_the_desktop_theme_is_followed(window, preferences, qapp, monkeypatch):
    preferences.close()
    window.registry.run("theme.system")
    for scheme in (Qt.ColorScheme.Dark, Qt.ColorScheme.Light):
        monkeypatch.setattr(type(qapp.styleHints()), "colorScheme", lambda self, scheme=scheme: scheme)
        qapp.styleHints().colorSchemeChanged.emit(scheme)
        assert is_dark(qapp.palette()) is (scheme == Qt.ColorScheme.Dark)
    window.registry.run("theme.dark")
    qapp.styleHints().colorSchemeChanged.emit(Qt.ColorScheme.Light)
    assert is_dark(qapp.palette())  # one's own choice stays


def shown(table, action_id: str) -> str:
    """What the table says about an action's keys."""
    return table.table.item(table.ids.index(action_id), 1).text()


def test_keys_are_changed_and_a_clash_is_named(qtbot, window, preferences, screenshot):
    preferences.tabs.setCurrentIndex(1)
    table = preferences.shortcuts
    qtbot.keyClicks(table.search, "history")
    table.table.selectRow(table.ids.index("edit.history"))
    table.keys.setFocus()
    qtbot.keyClick(table.keys, Qt.Key.Key_M)
    qtbot.mouseClick(table.set, Qt.MouseButton.LeftButton)
    assert "M is the shortcut of “Show masks”" in table.complaint.text()
    assert shown(table, "edit.history") == "Ctrl+H"
    screenshot(window, "shortcuts-clash")
    qtbot.keyClick(table.keys, Qt.Key.Key_F7)
    qtbot.mouseClick(table.set, Qt.MouseButton.LeftButton)
    assert (shown(table, "edit.history"), table.complaint.text()) == ("F7", "")
    table.table.selectRow(table.ids.index("masks.shown"))
    qtbot.mouseClick(table.none, Qt.MouseButton.LeftButton)
    preferences.close()
    on.dock(window, "History").hide()
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    qtbot.keyClick(window, Qt.Key.Key_F7)
    qtbot.waitUntil(on.dock(window, "History").isVisible)
    assert ("F7", "History") in window.registry.cheat_sheet()["Edit"]
    again = Shell(SettingsFile(window.settings.path), FEATURES)
    qtbot.addWidget(again)
    assert again.menus.actions["edit.history"].shortcut().toString() == "F7"
    assert again.menus.actions["masks.shown"].shortcuts() == []
    again.registry.run("edit.preferences")
    table = again.findChild(PreferencesDialog).shortcuts
    qtbot.mouseClick(table.all_defaults, Qt.MouseButton.LeftButton)
    assert (shown(table, "edit.history"), again.settings.value.shortcuts) == ("Ctrl+H", {})
    again.findChild(QDialog, "preferences").close()
    again.close()


def test_the_help_explains_every_layer(window, screenshot):
    from degense.app.features.viewer.layer_help import FORMULAS, UNITS
    from degense.engine.layers import LAYERS

    assert set(FORMULAS) == set(LAYERS)
    assert set(UNITS) == {layer.name for layer in LAYERS.values() if layer.kind == "scalar"}
    window.registry.run("help.layers")
    dialog = next(dialog for dialog in window.findChildren(QDialog) if dialog.windowTitle() == "What the layers show")
    text = dialog.findChild(QTextBrowser).toPlainText()
    for layer in LAYERS.values():
        assert layer.title in text
        assert layer.description in text
    assert "not a medical device" in text
    screenshot(window, "layer-help")
    dialog.close()
