"""Work survives: closing and opening again, a killed window, a damaged session file, a full disk."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QWheelEvent
from PySide6.QtWidgets import QApplication, QMessageBox

from degense.app.features.welcome.samples import PROMPT
from degense.app.session.state_folder import JOURNAL, folder_of, left_behind
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError
from tests.app import installed as on
from tests.house.source import ROOT

#: A window in a process of its own: opens a run, adds a prompt, then erases along a line in one stroke without end, and says how far it is.
WINDOW = """
import sys
import time
from pathlib import Path
from PySide6.QtCore import QEvent, QPointF, Qt, QTimer
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication
from degense.app.shell.settings import SettingsFile
from degense.app.application import FEATURES
from degense.app.shell.shell import Shell
from tests.app import installed as on

app = QApplication([])
window = Shell(SettingsFile(Path(sys.argv[2])), FEATURES)
panel, left = on.viewer(window).panel, Qt.MouseButton.LeftButton
x = 10.0

def mouse(kind):
    place = panel.zoom.to_widget(QPointF(x, 40.0))
    app.sendEvent(panel, QMouseEvent(kind, place, panel.mapToGlobal(place), left, left, Qt.KeyboardModifier.NoModifier))

def work():
    if window.session.scene is not None:
        window.session.view.add_prompt("liver")
    window.session.view.set_layer("depth")
    window.registry.run("annotate.mode")
    on.annotations(window).tool.choose("eraser", radius=3.0)
    QTimer.singleShot(1500, paint)  # the prompt is in the journal then

def paint():
    if any(window.worker.busy(name) for name in ("open", "view", "range")) or panel._frame is None:
        QTimer.singleShot(100, paint)
        return
    mouse(QEvent.Type.MouseButtonPress)
    timer.start(50)

def step():
    global x
    x += 1
    mouse(QEvent.Type.MouseMove)
    print(int(x), flush=True)

timer = QTimer()
timer.timeout.connect(step)
on.viewer(window).splats_added.connect(lambda: on.documents(window).open_path(Path(sys.argv[1])))
window.session.opened.connect(lambda: QTimer.singleShot(0, work))
window.show()
app.exec()
"""


NONE = Qt.KeyboardModifier.NoModifier


def click(qtbot, box: QMessageBox, text: str) -> None:
    button = next(button for button in box.buttons() if button.text().replace("&", "").startswith(text))
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def test_a_run_opens_as_it_was_left(qtbot, opened, run, idle, screenshot):
    session = opened.session
    session.view.add_prompt("liver")
    session.view.set_layer("depth")
    session.go_to(6)
    idle()
    qtbot.mousePress(on.viewer(opened).splats._canvas, Qt.MouseButton.LeftButton, pos=on.viewer(opened).splats.rect().center())
    qtbot.mouseMove(on.viewer(opened).splats._canvas, on.viewer(opened).splats.rect().center() / 2)
    qtbot.mouseRelease(on.viewer(opened).splats._canvas, Qt.MouseButton.LeftButton, pos=on.viewer(opened).splats.rect().center() / 2)
    assert session.camera_mode == "free"
    camera = on.viewer(opened).splats.camera.current()
    on.dock(opened, "Log").show()
    opened.registry.run("file.save")
    on.dock(opened, "Log").hide()
    session.go_to(2)
    at = QPointF(on.viewer(opened).panel.rect().center())
    wheel = QWheelEvent(at, at, QPoint(), QPoint(0, 360), Qt.MouseButton.NoButton, NONE, Qt.ScrollPhase.NoScrollPhase, False)
    QApplication.sendEvent(on.viewer(opened).panel, wheel)
    qtbot.mousePress(on.viewer(opened).panel, Qt.MouseButton.RightButton, pos=at.toPoint())
    qtbot.mouseMove(on.viewer(opened).panel, at.toPoint() + QPoint(90, 40))
    qtbot.mouseRelease(on.viewer(opened).panel, Qt.MouseButton.RightButton, pos=at.toPoint() + QPoint(90, 40))
    seen = on.viewer(opened).panel.zoom.view()
    on.documents(opened).open_demo()
    idle()
    assert [prompt.text for prompt in session.view_state.prompts] == [PROMPT]  # the demo's own
    assert on.viewer(opened).panel.zoom.fitted
    on.documents(opened).open_path(run)
    idle()
    qtbot.wait(50)
    assert np.allclose(on.viewer(opened).panel.zoom.view(), seen)
    assert not on.viewer(opened).panel.zoom.fitted
    assert (session.view_state.layer, [prompt.text for prompt in session.view_state.prompts]) == ("depth", ["liver"])
    assert (session.frame, on.time(opened).timeline.frame(), session.camera_mode) == (2, 2, "free")  # left at 2, saved on leaving
    assert np.allclose(on.viewer(opened).splats.camera.current().viewmat, camera.viewmat)
    assert not on.dock(opened, "Log").isVisible()
    assert not opened.isWindowModified()
    screenshot(opened, "reopened")


@pytest.mark.parametrize("kind", ["run", "clip"])
def test_a_killed_window_gives_its_work_back_at_the_next_start(qtbot, window, kind, run, tiny_clip, idle, tmp_path, screenshot):
    """kill -9 amid a stroke that has lasted for seconds: at most its last two are lost, and nothing else."""
    path = run if kind == "run" else shutil.copytree(tiny_clip, tmp_path / "clip")
    folder, prompts = (path, ["liver"]) if kind == "run" else (path / "annotations", [])
    settings = tmp_path / "other.json"
    with subprocess.Popen([sys.executable, "-c", WINDOW, str(path), str(settings)], cwd=ROOT, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        printed: list[tuple[float, int]] = []
        while len(printed) < 10 or time.monotonic() - printed[9][0] < 2.2:
            x = int(child.stdout.readline())
            printed.append((time.monotonic(), x))
        killed = time.monotonic()
        os.kill(child.pid, signal.SIGKILL)
    safe = max(x for moment, x in printed if moment < killed - 2)
    assert left_behind() == [path.resolve()]  # as the next start finds it
    on.documents(window).open_path(path)
    idle()
    box = window.findChild(QMessageBox, "recovery")
    assert "(annotations, view)" in box.informativeText()
    assert window.session.view_state.prompts == ()
    screenshot(window, "recovery")
    click(qtbot, box, "Restore")
    idle()
    assert (window.session.view_state.layer, [prompt.text for prompt in window.session.view_state.prompts]) == ("depth", prompts)
    assert safe > 15
    assert (on.annotations(window).labels(0)[40, 10:safe] == UNLABELLED).all()
    assert window.isWindowModified()
    window.registry.run("file.save")
    assert not (folder_of(folder) / JOURNAL).exists()
    assert not window.isWindowModified()


def test_a_damaged_session_offers_its_backup(qtbot, opened, run, idle, screenshot):
    opened.session.view.add_prompt("liver")
    opened.registry.run("file.save")
    opened.session.view.set_layer("depth")
    opened.registry.run("file.save")
    on.documents(opened).open_demo()
    idle()
    (run / "session.json").write_text("{half a fi")
    on.documents(opened).open_path(run)
    idle()
    assert opened.session.scene is None
    box = opened.findChild(QMessageBox, "damaged session")
    screenshot(opened, "damaged-session")
    click(qtbot, box, "Backup of")
    idle()
    assert [prompt.text for prompt in opened.session.view_state.prompts] == ["liver"]
    assert (run / "session.json.bad").read_text() == "{half a fi"


def test_autosave_waits_for_its_time_and_for_the_hand(qtbot, opened, run, monkeypatch):
    now = [1000.0]
    monkeypatch.setattr("degense.app.features.documents.autosave.time.monotonic", lambda: now[0])
    opened.settings.update(autosave=2.0)
    opened.session.view.set_threshold(0.25)
    on.autosave(opened).tick()
    now[0] += 119
    on.autosave(opened).tick()
    assert opened.session.dirty
    monkeypatch.setattr("degense.app.features.documents.autosave.QApplication.mouseButtons", lambda: Qt.MouseButton.LeftButton)
    now[0] += 2
    on.autosave(opened).tick()
    assert opened.session.dirty  # amid a drag
    monkeypatch.undo()
    monkeypatch.setattr("degense.app.features.documents.autosave.time.monotonic", lambda: now[0])
    on.autosave(opened).tick()
    assert not opened.session.dirty


def test_work_that_cannot_be_saved_is_not_left_silently(qtbot, opened, idle, monkeypatch, screenshot):
    opened.session.view.add_prompt("liver")

    def full(path: Path, parts: object) -> None:
        raise DegenseError(f"{path} cannot be written: No space left on device; what was there before is untouched.")

    with monkeypatch.context() as patch:
        patch.setattr("degense.app.session.session_file.write", full)
        opened.close()
        assert opened.isVisible()
        box = opened.findChild(QMessageBox, "unsaved")
        assert "No space left" in box.text()
        screenshot(opened, "unsaved")
        click(qtbot, box, "Stay")
    assert opened.isVisible()
    assert opened.isWindowModified()
    opened.registry.run("file.save")
    assert not opened.isWindowModified()


@pytest.mark.parametrize("answer", ["Discard", "Restore"])
def test_recovered_work_is_asked_about_once(qtbot, opened, run, idle, answer):
    opened.session.view.set_threshold(0.25)
    opened.session.store.write_pending()
    journal = (folder_of(run) / JOURNAL).read_bytes()
    on.documents(opened).open_demo()
    idle()
    (run / "session.json").unlink()
    (folder_of(run) / JOURNAL).write_bytes(journal)
    for asked in (True, False):
        on.documents(opened).open_path(run)
        idle()
        box = opened.findChild(QMessageBox, "recovery")
        assert (box is not None) is asked
        if box is not None:
            click(qtbot, box, answer)
            qtbot.wait(10)
        assert opened.session.view_state.threshold == (0.25 if answer == "Restore" else 0.5)
        on.documents(opened).open_demo()
        idle()
