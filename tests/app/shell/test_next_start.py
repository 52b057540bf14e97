"""The program killed amid work, and what its next start offers: programs of their own that run `run_window`, used by mouse and keys."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from degense.app.session.state_folder import JOURNAL, folder_of, left_behind
from tests.house.source import ROOT

#: Starts the program with a path, or without one for "-", and does the steps of the last argument in its window.
PROGRAM = """
import json
import os
import sys
import time
import traceback
from pathlib import Path
from PySide6.QtCore import QEventLoop, QPoint, Qt, QTimer
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMessageBox
from degense.app import application
from degense.app.features.documents.controller import Documents
from degense.app.features.viewer.controller import Viewer


class Watched(application.Shell):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        QTimer.singleShot(1, self.act)

    def until(self, done):
        end = time.monotonic() + 60
        while not done():
            if time.monotonic() > end:
                traceback.print_stack()
                os._exit(1)
            loop = QEventLoop()  # not QTest.qWait, beside which other threads stand still
            QTimer.singleShot(20, loop.quit)
            loop.exec()

    def settled(self):
        self.until(lambda: self.session.frames and not any(self.worker.busy(name) for name in ("open", "view", "range")))

    def act(self):
        self.activateWindow()
        self.until(lambda: self.windowHandle() is not None and self.windowHandle().isExposed())
        self.settled()
        for step in sys.argv[2:]:
            getattr(self, step)()
        self.close()

    def prompt(self):
        for key in "/liver":
            top = QApplication.activePopupWidget() or self
            QTest.keyClick(top.windowHandle(), key)
        QTest.keyClick((QApplication.activePopupWidget() or self).windowHandle(), Qt.Key.Key_Escape)
        QTest.keyClick(self.windowHandle(), Qt.Key.Key_Return)
        self.until(lambda: self.session.view_state.prompts)
        print("working", flush=True)
        self.until(lambda: False)

    def asked(self):
        return next((box for box in self.findChildren(QMessageBox, "recovery") if box.isVisible()), None)

    def tell(self):
        box = self.asked()
        print(json.dumps({
            "open": str(self.service(Documents).path),
            "asked": box.informativeText() if box is not None else "",
            "prompts": [prompt.text for prompt in self.session.view_state.prompts],
            "notice": self.status.notice.text() if self.status.notice.isVisible() else "",
        }), flush=True)

    def picture(self):
        if folder := os.environ.get("DEGENSE_SCREENSHOTS"):
            self.until(lambda: self.service(Viewer).view is not None)
            QApplication.primaryScreen().grabWindow(self.winId()).save(f"{folder}/next-start.png")

    def restore(self):
        box = self.asked()
        [button] = [button for button in box.buttons() if button.text().replace("&", "") == "Restore"]
        QTest.mouseClick(button, Qt.MouseButton.LeftButton)
        self.until(lambda: not box.isVisible())
        self.settled()

    def follow(self):
        notice, before = self.status.notice, self.service(Documents).path
        at = notice.mapTo(self, QPoint(12, notice.height() // 2))
        QTest.mouseMove(self.windowHandle(), at)
        QTest.mouseClick(self.windowHandle(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, at)
        self.until(lambda: self.service(Documents).path != before)
        self.settled()


application.Shell = Watched
sys.exit(application.run_window(None if sys.argv[1] == "-" else Path(sys.argv[1])))
"""


def started(path: Path | None, *steps: str) -> list[dict[str, str]]:
    """What a start of the program told."""
    command = [sys.executable, "-c", PROGRAM, str(path or "-"), *steps]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=200)
    assert result.returncode == 0, result.stderr
    return [json.loads(line) for line in result.stdout.splitlines() if line.startswith("{")]


def killed(path: Path) -> None:
    """Open a run, type a prompt, and kill the program as soon as the journal has it."""
    command = [sys.executable, "-c", PROGRAM, str(path), "prompt"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        while child.stdout.readline().strip() != "working":
            assert child.poll() is None
        journal = folder_of(path) / JOURNAL
        while not (journal.is_file() and "liver" in journal.read_text(encoding="utf-8")):
            time.sleep(0.05)
        os.kill(child.pid, signal.SIGKILL)


@pytest.fixture
def runs(trained: Path, tmp_path: Path) -> list[Path]:
    """Two runs in which the program was killed, the last one last, and one in which nothing was done."""
    paths = [shutil.copytree(trained, tmp_path / name / "run") for name in ("first", "second", "other")]
    killed(paths[0])
    killed(paths[1])
    assert left_behind() == [paths[1], paths[0]]
    return paths


def test_left_behind_work_is_offered_without_a_path(runs):
    first, second, _ = runs
    told = started(None, "tell", "restore", "tell", "picture", "follow", "tell", "restore", "tell")
    newest, restored, other, last = told
    assert (newest["open"], newest["prompts"]) == (str(second), [])
    assert "of run could be saved (view" in newest["asked"]
    assert "Open first/run" in newest["notice"]
    assert "Another run or clip has unsaved work" in newest["notice"]
    assert restored["prompts"] == ["liver"]
    assert (other["open"], other["prompts"], other["notice"]) == (str(first), [], "")
    assert other["asked"]
    assert last["prompts"] == ["liver"]
    assert left_behind() == []  # all of it was saved on leaving


def test_left_behind_work_is_offered_beside_a_path(runs):
    first, second, fresh = runs
    [told] = started(fresh, "tell")
    assert (told["open"], told["asked"]) == (str(fresh), "")
    assert told["notice"].index("Open second/run") < told["notice"].index("Open first/run")
    assert "2 other runs and clips have unsaved work" in told["notice"]
    assert left_behind() == [second, first]  # nothing of it was touched
    [told] = started(first, "tell")  # which is offered as it is opened
    assert told["asked"]
    assert "Open first/run" not in told["notice"]
    assert "Open second/run" in told["notice"]
