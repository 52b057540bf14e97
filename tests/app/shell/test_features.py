"""A feature can be taken out: without any one of them the window starts, scrubs and closes."""

from __future__ import annotations

import pytest
from PySide6.QtWidgets import QMessageBox

from degense.app.application import FEATURES
from degense.app.features.timeline.controller import TimeControl
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.settings import SettingsFile
from degense.app.shell.shell import Shell


@pytest.mark.parametrize("left_out", FEATURES, ids=[install.__module__.split(".")[-2] for install in FEATURES])
def test_the_window_lives_without(left_out, qtbot, qapp, tmp_path, scene):
    window = Shell(SettingsFile(tmp_path / "settings.json"), [install for install in FEATURES if install is not left_out])
    qtbot.addWidget(window)
    window.show()
    window.session.open_scene(scene)
    if (views := window.service(Viewer)) is not None:
        qtbot.waitUntil(lambda: views.splats is not None)
    qtbot.waitUntil(lambda: window.worker.idle())
    for frame in (1, scene.frames - 1, scene.frames - 2):
        window.session.go_to(frame)
        qtbot.waitUntil(lambda: window.worker.idle())
    if (time := window.service(TimeControl)) is not None:
        assert (time.timeline.count(), time.timeline.frame()) == (scene.frames, scene.frames - 2)
    assert window.close()
    assert window.findChild(QMessageBox, "error") is None


def test_without_any_feature(qtbot, qapp, tmp_path, scene):
    window = Shell(SettingsFile(tmp_path / "settings.json"))
    qtbot.addWidget(window)
    window.show()
    window.session.open_scene(scene)
    window.session.step(1)
    assert window.session.frame == 1
    assert window.close()
