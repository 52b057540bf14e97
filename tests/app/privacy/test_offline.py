"""The product asks nothing of a network: its main paths work in a process where every socket is refused."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.house.source import ROOT

#: What every Python process of a test begins with: each use of an internet socket is written down and refused.
REFUSE = """
import os
import sys
def refuse(event, arguments):
    if event in ("socket.connect", "socket.bind", "socket.sendto", "socket.getaddrinfo", "socket.gethostbyname", "urllib.Request"):
        file = os.open(os.environ["ASKED"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        os.write(file, f"{os.getpid()} {event} {arguments[1:]}\\n".encode())
        os.close(file)
        raise OSError("no network in this test")
sys.addaudithook(refuse)
"""
PLACES = """
import sys
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
do("render", run, "--frame", 2, "--layer", "displacement", "--out", folder / "layer.png")
do("track", run, "--grid", 3, "--json", folder / "tracks.json")
do("checksum", run)
do("annotate", run, "--labels", folder / "clip" / "labels" / "000000.png", "--frame", 0, "--out", folder / "maps")
do("import", folder / "clip", folder / "coco.json", "--format", "coco")
do("datasets", folder)
do("cache")
assert main(["doctor"]) in (0, 1)  # 1: it says that this machine lacks something
small = ("--preset", "quick", "--iterations", 30, "--max-gaussians", 500, "--device", "cpu", "--slots", 2)
do("batch", folder / "clip", folder / "clip", "--out", folder / "batch", *small, "--prompt", "liver")
do("compare", folder / "clip", "--out", folder / "compared", "--methods", "dgd,degense", *small[:-2])
do("movie", run, "--out", folder / "movie.mp4")
do("share", run, "--out", folder / "page.html")
do("demo", "--headless", folder / "demo")
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
"""
ATTEMPT = """
import socket
import subprocess
attempt = "import socket; socket.create_connection(('127.0.0.1', 9), timeout=1)"
assert "no network in this test" in subprocess.run([sys.executable, "-c", attempt], stderr=subprocess.PIPE, text=True).stderr
try:
    socket.create_connection(("127.0.0.1", 9), timeout=1)
except OSError as error:
    assert str(error) == "no network in this test", error
"""


def asked_by(code: str, folder: Path) -> list[str]:
    """What a process that runs `code`, or one that it starts, asked of a network: a line each, which begins with the process."""
    hook = folder / "hook"
    hook.mkdir()
    (hook / "sitecustomize.py").write_text(REFUSE)
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "NUMBA_NUM_THREADS": "2", "PYTHONPATH": str(hook)}
    command = [sys.executable, "-c", PLACES + code, str(folder)]
    file = folder / "asked"
    result = subprocess.run(command, cwd=ROOT, env={**environment, "ASKED": str(file)}, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr[-2000:]
    return file.read_text().splitlines() if file.exists() else []


def test_commands_need_no_network(tmp_path):
    assert asked_by(COMMANDS, tmp_path) == []
    assert (tmp_path / "demo").is_dir()


def test_the_window_needs_no_network(tmp_path):
    assert asked_by(WINDOW, tmp_path) == []


def test_attempts_are_seen_also_of_processes_that_are_started(tmp_path):
    attempts = asked_by(ATTEMPT, tmp_path)
    assert len(attempts) == 2
    assert len({line.split()[0] for line in attempts}) == 2
