"""The product asks nothing of a network: its main paths work in a process where every socket is refused."""

from __future__ import annotations

import os
import subprocess
import sys

from tests.house.source import ROOT

#: Put first: every use of an internet socket from here on, in this process, is written down and refused.
REFUSE = """
import sys
asked = []
def refuse(event, arguments):
    if event in ("socket.connect", "socket.bind", "socket.sendto", "socket.getaddrinfo", "socket.gethostbyname", "urllib.Request"):
        asked.append(f"{event} {arguments[1:]}")
        raise OSError("no network in this test")
sys.addaudithook(refuse)
from pathlib import Path
folder, run = Path(sys.argv[1]), Path(sys.argv[1]) / "runs" / "one"
"""
COMMANDS = """
from degense.app.cli.main import main
def do(*words):
    assert main([str(word) for word in words]) == 0, words
do("phantom", folder / "clip", "--frames", 6, "--size", "64x48")
do("info", folder / "clip")
do("train", folder / "clip", "--out", run, "--preset", "quick", "--iterations", 30, "--max-gaussians", 500, "--device", "cpu")
do("eval", run, "--report", folder / "report")
do("query", run, "liver", "grasper near liver")
do("search", run.parent, "liver")
do("segment", run, "--prompt", "liver", "--frame", 2, "--out", folder / "mask.png")
do("export", run, "--format", "ply", "--out", folder / "scene.ply")
do("export", run, "--format", "coco", "--out", folder / "coco.json")
do("movie", run, "--out", folder / "movie.mp4")
do("share", run, "--out", folder / "page.html")
do("demo", "--headless", folder / "demo")
assert not asked, asked
"""
WINDOW = """
from PySide6.QtWidgets import QApplication
from degense.app.application import FEATURES
from degense.app.features.documents.controller import Documents
from degense.app.session.sample import demo_run
from degense.app.shell.settings import SettingsFile
from degense.app.shell.shell import Shell
app = QApplication([])
window = Shell(SettingsFile(folder / "settings.json"), FEATURES)
window.service(Documents).open_path(demo_run())
while window.session.scene is None or not window.worker.idle("diagnostics"):
    app.processEvents()
window.session.view.add_prompt("liver")
while not window.worker.idle("diagnostics"):
    app.processEvents()
window.close()
assert not asked, asked
"""
ATTEMPT = """
import socket
try:
    socket.create_connection(("127.0.0.1", 9), timeout=1)
except OSError as error:
    assert str(error) == "no network in this test", error
assert asked
"""


def run(code: str, folder) -> None:
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "NUMBA_NUM_THREADS": "2"}
    command = [sys.executable, "-c", REFUSE + code, str(folder)]
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[-2000:]


def test_commands_need_no_network(tmp_path):
    run(COMMANDS, tmp_path)
    assert (tmp_path / "demo").is_dir()


def test_the_window_needs_no_network(tmp_path):
    run(WINDOW, tmp_path)


def test_an_attempt_is_seen(tmp_path):
    run(ATTEMPT, tmp_path)
