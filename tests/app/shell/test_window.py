"""The window's table of actions, its palette, dialogs, exports and log."""

from __future__ import annotations

import logging
import re
import subprocess
import sys
from importlib.metadata import version

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QDialog, QMessageBox

from degense.app.shell.palette import Palette
from degense.engine.layers import LAYERS
from tests.app import installed as on
from tests.house.source import ROOT, imports, modules, within


def test_menus_hold_every_action_and_keys_the_layers(window):
    for entry in window.registry:
        assert window.menus.actions[entry.id].text().startswith(entry.title)
        assert not entry.menu or window.menus.actions[entry.id] in window.menus.menu(entry.menu).actions()
    assert [entry.id for entry in window.registry if entry.id.startswith("layer.")] == [f"layer.{name}" for name in LAYERS]
    assert [key for name in LAYERS if (key := window.menus.actions[f"layer.{name}"].shortcut().toString())] == list("123456978")


def test_an_empty_window_offers_only_what_is_possible(window, screenshot):
    enabled = {entry.id for entry in window.registry if entry.enabled()}
    assert {"file.open-clip", "file.open-run", "file.demo", "help.keys"} <= enabled
    assert not {entry for entry in enabled if entry.startswith(("layer.", "play.", "compare.", "export."))}
    screenshot(window, "empty")


def test_the_palette_finds_and_runs(qtbot, opened, idle, screenshot):
    opened.registry.run("help.palette")
    palette = opened.findChild(Palette)
    qtbot.keyClicks(palette.input, "displ")
    screenshot(opened, "palette")
    qtbot.keyClick(palette.input, Qt.Key.Key_Return)
    idle()
    assert opened.session.view_state.layer == "displacement"


def test_the_hint_of_the_empty_window_names_a_menu_that_is_there(window):
    path = re.search(r"(\w+) ▸ (\w+)", on.viewer(window).panel._message)
    assert any((action.menu, action.title) == ((path[1],), path[2]) for action in window.registry)


def test_the_status_bar_says_what_the_mouse_would_do(qtbot, opened, idle, screenshot):
    """Over each view, with a tool, and under a message; nothing elsewhere."""
    panel, splats, hint = on.viewer(opened).panel, on.viewer(opened).splats, opened.status.hint

    def over(widget) -> str:
        QTest.mouseMove(widget, widget.rect().center() + QPoint(1, 1))
        QTest.mouseMove(widget, widget.rect().center())
        qtbot.wait(50)
        return hint.text()

    assert over(panel).startswith("Click: follow this place · drag: move")
    screenshot(opened, "hint")
    assert "drag: turn" in over(splats.focusProxy())
    over(panel)
    opened.registry.run("inspect.rectangle")
    assert hint.text().startswith("Drag: draw around")
    opened.registry.run("inspect.rectangle")
    opened.registry.run("annotate.mode")
    assert hint.text().startswith("Paint the current class")
    qtbot.keyClick(panel, Qt.Key.Key_E)
    assert hint.text().startswith("Make pixels unlabelled")
    opened.registry.run("annotate.mode")
    opened.say("Saved")
    assert not hint.isVisible()
    opened.statusBar().clearMessage()
    assert hint.isVisible()
    assert over(opened.menuBar()) == ""


def test_zoom_full_screen_and_close(qtbot, opened, idle, screenshot):
    panel, session = on.viewer(opened).panel, opened.session
    panel.setFocus()
    fitted = panel.zoom.factor()
    qtbot.keyClick(panel, Qt.Key.Key_Plus, Qt.KeyboardModifier.ControlModifier)
    assert panel.zoom.factor() == pytest.approx(1.25 * fitted)
    qtbot.keyClick(panel, Qt.Key.Key_Minus, Qt.KeyboardModifier.ControlModifier)
    assert panel.zoom.factor() == pytest.approx(fitted)
    qtbot.keyClick(panel, Qt.Key.Key_0, Qt.KeyboardModifier.ControlModifier)
    assert panel.zoom.factor() == 1.0
    qtbot.keyClick(panel, Qt.Key.Key_F)
    assert panel.zoom.factor() == fitted
    qtbot.keyClick(panel, Qt.Key.Key_F11)
    assert opened.isFullScreen()
    qtbot.keyClick(panel, Qt.Key.Key_F11)
    assert not opened.isFullScreen()
    session.view.add_prompt("liver")
    folder = session.scene.run.path
    qtbot.keyClick(panel, Qt.Key.Key_W, Qt.KeyboardModifier.ControlModifier)
    idle()
    assert (session.scene, session.clip, session.frames, opened.windowTitle()) == (None, None, 0, "DeGense[*]")
    assert not on.viewer(opened).splats.isVisible()
    assert panel._frame is None
    screenshot(opened, "closed")
    on.documents(opened).open_path(folder)  # it was saved
    idle()
    assert [prompt.text for prompt in session.view_state.prompts] == ["liver"]


def test_the_cheat_sheet_lists_all_keys(opened, screenshot):
    opened.registry.run("help.keys")
    [dialog] = [dialog for dialog in opened.findChildren(QDialog) if dialog.windowTitle() == "Shortcuts"]
    screenshot(opened, "cheat-sheet")
    dialog.close()


def test_about_says_what_it_is_not(window):
    window.registry.run("help.about")
    box = QApplication.activeModalWidget()
    assert isinstance(box, QMessageBox)
    assert "not a medical device" in box.text()
    assert version("degense") in box.text()
    box.close()


def test_diagnostics_report_from_the_worker(qtbot, window, monkeypatch):
    monkeypatch.setattr("degense.app.diagnostics.report", lambda: ("all is well", True))
    window.registry.run("help.diagnostics")
    qtbot.waitUntil(lambda: any(dialog.windowTitle() == "Diagnostics" for dialog in window.findChildren(QDialog)))
    next(dialog for dialog in window.findChildren(QDialog) if dialog.windowTitle() == "Diagnostics").close()


def test_the_picture_is_saved_as_shown_with_its_colour_bar(opened, idle, tmp_path):
    on.exporter(opened).save_frame(tmp_path / "a.png")
    assert np.array_equal(cv2.imread(str(tmp_path / "a.png"))[..., ::-1], opened.session.scene.render_rgb(0))
    opened.session.view.set_layer("depth")
    idle()
    on.exporter(opened).save_frame(tmp_path / "b.png")
    assert cv2.imread(str(tmp_path / "b.png")).shape[1] > 96


def test_export_runs_in_the_worker(opened, idle, tmp_path):
    opened.session.view.add_prompt("liver")
    on.exporter(opened).export("masks-png", tmp_path / "masks")
    idle()
    assert len(list((tmp_path / "masks" / "labels").iterdir())) == 10
    on.exporter(opened).export("masks-png", tmp_path / "masks")
    idle()
    box = opened.findChild(QMessageBox, "error")
    assert "not empty" in box.text()
    box.close()


def test_an_export_is_stopped(opened, idle, tmp_path):
    on.exporter(opened).export("movie", tmp_path / "a.mp4")
    opened.menus.refresh()
    opened.menus.actions["export.stop"].trigger()
    idle()
    assert not opened.status.busy_bar.isVisible()
    assert not (tmp_path / "a.mp4").exists()
    assert not opened.registry["export.stop"].enabled()


def test_menus_are_current_after_a_task(opened, idle, monkeypatch):
    told, refreshed = [], []
    monkeypatch.setattr(opened.menus, "refresh", lambda: refreshed.append(list(told)))
    opened.run_task("export", "Counting", lambda: 3, told.append)
    idle()
    assert refreshed[-1:] == [[3]]


def test_quit_closes_the_window(qtbot, window):
    window.menus.actions["file.quit"].trigger()
    qtbot.waitUntil(lambda: not window.isVisible())


def test_a_crash_leaves_its_stacks(tmp_path):
    """The processor's own faults go past Python; the stacks of all threads are written by the system's handler."""
    code = (
        "import faulthandler, sys; from pathlib import Path; from degense.app.shell.logs import start_logging\n"
        "start_logging(Path(sys.argv[1]), print)\n"
        "def deep(): faulthandler._sigsegv()\n"
        "deep()"
    )
    result = subprocess.run([sys.executable, "-c", code, str(tmp_path / "degense.log")], cwd=ROOT, capture_output=True)
    assert result.returncode != 0
    text = (tmp_path / "degense.crash").read_text()
    assert "Segmentation fault" in text
    assert "in deep" in text


def test_the_shell_knows_no_feature():
    for path in modules("app/shell"):
        assert not [name for _, name in imports(path) if within(name, ("degense.app.features", "degense.app.application"))], path


def test_what_is_not_caught_goes_to_the_log_and_in_one_sentence_to_the_user(window, qtbot, tmp_path, monkeypatch):
    from degense.app.shell.logs import start_logging

    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    monkeypatch.setattr("threading.excepthook", lambda args: None)
    monkeypatch.setattr("faulthandler.enable", lambda file: file.close())
    try:
        start_logging(tmp_path / "x" / "degense.log", window.complaint.emit)
        try:
            raise ZeroDivisionError("by zero")
        except ZeroDivisionError as error:
            sys.excepthook(type(error), error, error.__traceback__)
        qtbot.waitUntil(lambda: window.findChild(QMessageBox, "error") is not None)
        box = window.findChild(QMessageBox, "error")
        assert "ZeroDivisionError: by zero" in box.text()
        assert "Traceback" not in box.text()
        box.close()
        assert "Traceback" in (tmp_path / "x" / "degense.log").read_text()
        assert "uncaught exception" in on.dock(window, "Log").widget().toPlainText()
    finally:
        from PySide6.QtCore import qInstallMessageHandler

        qInstallMessageHandler(None)
        for handler in set(root.handlers) - set(before):
            root.removeHandler(handler)
            handler.close()
        root.setLevel(level)
        for handler in set(before) - set(root.handlers):
            root.addHandler(handler)


@pytest.mark.parametrize("name", ["x", "y"])
def test_nothing_is_left_after_closing(qtbot, tmp_path, name):
    from degense.app.application import FEATURES
    from degense.app.shell.settings import SettingsFile
    from degense.app.shell.shell import Shell

    window = Shell(SettingsFile(tmp_path / "settings.json"), FEATURES)
    window.show()
    window.close()  # before the 3D view has come
    qtbot.wait(20)
    assert on.viewer(window).splats is None
    window.deleteLater()
