"""Task: open a run, a clip, a file that is none; by command, by drop, by the recent list."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent
from PySide6.QtWidgets import QMessageBox

from degense.app.application import FEATURES
from degense.app.features.train.train_dialog import TrainDialog
from degense.app.session.sample import ASSETS, SAMPLE
from degense.app.shell.settings import SettingsFile
from degense.app.shell.shell import Shell
from degense.engine.data.readers import open_clip
from tests.app import installed as on


def error_text(window) -> str:
    box = window.findChild(QMessageBox, "error")
    text = box.text() if box is not None and box.isVisible() else ""
    if box is not None:
        box.close()
    return text


def test_open_a_run(opened, screenshot):
    session = opened.session
    assert opened.windowTitle().startswith("copy")
    assert on.time(opened).timeline.count() == session.frames == 10
    assert np.array_equal(on.viewer(opened).view.rgb, session.scene.render_rgb(0))
    assert np.array_equal(on.viewer(opened).panel.grab_image(), session.scene.render_rgb(0))
    assert on.viewer(opened).view.splats is not None
    assert "isolated routing" in on.documents(opened).facts.text.text()
    assert not on.documents(opened).facts.next_steps.isVisible()
    picture = on.viewer(opened).splats.screenshot_image()
    assert picture.std() > 10  # something is drawn in 3D
    screenshot(opened, "open-run")


def test_open_a_clip(window, tiny_clip, idle, screenshot):
    on.documents(window).open_path(tiny_clip)
    idle()
    session, facts = window.session, on.documents(window).facts
    assert session.scene is None
    assert np.array_equal(on.viewer(window).panel.grab_image(), session.clip.frame(0))
    assert "measured, from depth/" in facts.text.text()
    assert facts.next_steps.isVisible()
    assert window.menus.actions["train.start"].isEnabled()
    assert not window.menus.actions["layer.depth"].isEnabled()
    screenshot(window, "open-clip")


def test_drop_a_folder(window, run, idle):
    mime = QMimeData()
    mime.setUrls([QUrl.fromLocalFile(str(run))])
    position, nothing = QPointF(50, 50), Qt.KeyboardModifier.NoModifier
    window.dropEvent(QDropEvent(position, Qt.DropAction.CopyAction, mime, Qt.MouseButton.LeftButton, nothing))
    idle()
    assert window.session.scene is not None


def test_what_cannot_be_opened_is_one_sentence(opened, tmp_path, idle):
    (tmp_path / "letter.txt").write_text("Dear all")
    on.documents(opened).open_path(tmp_path / "letter.txt")
    idle()
    text = error_text(opened)
    assert "letter.txt" in text
    assert "Traceback" not in text
    assert opened.session.scene is not None  # what was open stays open


def test_a_damaged_run_is_one_sentence(window, run, idle):
    (run / "model.safetensors").write_bytes(b"\x00" * 100)
    on.documents(window).open_path(run)
    idle()
    assert "model.safetensors" in error_text(window)
    assert window.session.frames == 0


def test_a_run_without_its_clip_opens(window, run, idle, tmp_path):
    alone = run.rename(tmp_path / "alone")
    try:
        on.documents(window).open_path(alone)
        idle()
        assert window.session.scene is not None
        assert not window.menus.actions["layer.warp"].isEnabled()
        assert not window.menus.actions["compare.next"].isEnabled()
    finally:
        alone.rename(run)


def test_recent_files_and_the_place_of_the_window_come_back(qtbot, opened, run, idle):
    on.dock(opened, "Layers").hide()
    opened.resize(1200, 700)
    qtbot.wait(50)
    opened.close()
    again = Shell(SettingsFile(opened.settings.path), FEATURES)
    qtbot.addWidget(again)
    with qtbot.waitSignal(on.viewer(again).splats_added):
        again.show()
    assert on.dock(again, "Layers").isHidden()
    assert again.size() == opened.size()
    recent = next(menu for path, menu in again.menus._menus.items() if path == ("File",)).actions()
    menu = next(action.menu() for action in recent if action.text() == "Recent")
    menu.aboutToShow.emit()
    menu.actions()[0].trigger()
    qtbot.waitUntil(lambda: again.session.scene is not None)
    qtbot.waitUntil(lambda: on.viewer(again).view is not None)
    assert again.session.scene.run.path == run


def test_the_sample_is_not_changed_by_looking_at_it(window, run, idle, monkeypatch):
    import degense.app.session.sample

    monkeypatch.setattr(degense.app.session.sample, "ASSETS", run.parent.parent)
    monkeypatch.setattr(degense.app.session.sample, "SAMPLE", run.parent.name)
    assert degense.app.session.sample.is_demo(run)
    on.documents(window).open_path(run)
    idle()
    window.session.view.set_layer("depth")
    window.close()
    assert not (run / "session.json").exists()
    assert window.settings.value.recent == ()


def test_a_training_of_the_sample_goes_into_the_user_s_folder(window, monkeypatch, tmp_path):
    """The sample is part of the program, and may lie where nobody can write."""
    monkeypatch.setattr("pathlib.Path.home", lambda: tmp_path)
    dialog = TrainDialog(open_clip(ASSETS / SAMPLE / "clip"), {}, {}, False, window)
    assert dialog.out.text() == str(tmp_path / "clip-run")
