"""The product asks nothing of a network, and unpickles nothing but compiled kernels: its paths work in processes where every socket is
refused and every class that a pickle asks for is written down."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.house.source import ROOT
from tests.semantics.models.tiny_models import write_model

#: What reads numba's cache.
KERNELS = "/numba/core/"

#: What every Python process of a test begins with: each use of an internet socket is written down and refused, and each class that a pickle
#: asks for is written down with the file that reads it.
REFUSE = """
import os
import sys
def note(line):
    file = os.open(os.environ["ASKED"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.write(file, f"{os.getpid()} {line}\\n".encode())
    os.close(file)
def refuse(event, arguments):
    if event == "pickle.find_class":
        note(f"pickle {'.'.join(arguments)} by {sys._getframe(1).f_code.co_filename}")
    if event in ("socket.connect", "socket.bind", "socket.sendto", "socket.getaddrinfo", "socket.gethostbyname", "urllib.Request"):
        note(f"{event} {arguments[1:]}")
        raise OSError("no network in this test")
sys.addaudithook(refuse)
"""
PLACES = """
import sys
from pathlib import Path
folder, run = Path(sys.argv[1]), Path(sys.argv[1]) / "runs" / "one"
"""
DO = """
from degense.app.cli.main import main
def do(*words):
    assert main([str(word) for word in words]) == 0, words
small = ("--preset", "quick", "--iterations", 30, "--max-gaussians", 500, "--device", "cpu")
"""
COMMANDS = """
do("phantom", folder / "clip", "--frames", 6, "--size", "64x48")
do("info", folder / "clip")
do("train", folder / "clip", "--out", run, *small)
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
do("batch", folder / "clip", folder / "clip", "--out", folder / "batch", *small, "--slots", 2, "--prompt", "liver")
do("compare", folder / "clip", "--out", folder / "compared", "--methods", "dgd,degense", *small)
from degense.app.features.cameras.state import Stop, save_path
from degense.engine.scene import Scene
camera = Scene.open(run).camera(0)
save_path(folder / "path.json", (Stop("a", camera, 0.0, 0.2), Stop("b", camera, 4.0)))
do("render", run, "--cameras", folder / "path.json", "--out", folder / "flight.mp4")
do("movie", run, "--out", folder / "movie.mp4")
do("share", run, "--out", folder / "page.html")
do("demo", "--headless", folder / "demo")
"""
#: What loads a model of Hugging Face, or features and vectors that another program computed.
TEACHERS = """
import shutil
from safetensors.numpy import load_file
from degense.engine.data.files.images import read_index
from degense.engine.data.files.labels import read_classes
from degense.engine.semantics.text.text_vectors import write_vectors
from tests.semantics.teachers import peers
do("phantom", folder / "clip", "--frames", 4, "--size", "64x48")
model, classes, features = folder / "model", read_classes(folder / "clip" / "classes.json"), folder / "features"
do("train", folder / "clip", "--out", folder / "by-model", "--teacher", f"vlm:{model}", *small)
do("train", folder / "clip", "--out", folder / "by-words", "--encoder", model, *small)
do("segment", folder / "by-words", "--prompt", "the liver", "--encoder", model, "--frame", 1, "--out", folder / "mask.png")
features.mkdir()
vectors = peers.class_vectors(classes)
write_vectors(features / "text_vectors.safetensors", dict(zip(classes, vectors)), "made-up")
for frame in range(4):
    peers.agg(features, f"{frame:06d}", read_index(folder / "clip" / "labels" / f"{frame:06d}.png"), vectors)
do("train", folder / "clip", "--out", folder / "by-features", "--teacher", f"precomputed:{features}", *small)
do("query", folder / "by-features", "liver", "--encoder", features / "text_vectors.safetensors")
"""
WINDOW = """
from PySide6.QtWidgets import QApplication
from degense.app.application import FEATURES
from degense.app.features.archive.controller import ArchiveSearch
from degense.app.features.archive.dialog import SearchDialog
from degense.app.features.documents.controller import Documents
from degense.app.features.report.controller import SHOWN, Reporter
from degense.app.features.share.install import Sharing
from degense.app.features.train.controller import Training
from degense.app.features.train.job import TrainingJob
from degense.app.session.sample import demo_run
from degense.app.shell.settings import SettingsFile
from degense.app.shell.shell import Shell
do("phantom", folder / "clip", "--frames", 6, "--size", "64x48")
app = QApplication([])
window = Shell(SettingsFile(folder / "settings.json"), FEATURES)
def idle(until=lambda: True):
    app.processEvents()
    while not (window.worker.idle("diagnostics") and until()):
        app.processEvents()
window.service(Documents).open_path(folder / "clip")
idle(lambda: window.session.clip is not None)
training = window.service(Training)
training.start(TrainingJob(folder / "clip", run, "quick", iterations=30, max_gaussians=500, device="cpu"))
idle(lambda: not training.running and not training.queue.jobs)
window.service(Documents).open_path(run)
idle(lambda: window.session.scene is not None)
window.session.view.add_prompt("liver")
idle()
window.service(Reporter).export(folder / "report.html")
idle((folder / "report.html").is_file)
window.service(Sharing).write(folder / "page.html", SHOWN)
idle((folder / "page.html").is_file)
window.service(ArchiveSearch).show()
dialog = window.findChild(SearchDialog)
dialog.asked.emit(run.parent, "liver", False)
idle((run.parent / "degense-index.sqlite").is_file)
dialog.close()
window.service(Documents).open_path(demo_run())
idle(lambda: window.session.name != "one")
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


def foreign(lines: list[str]) -> list[str]:
    """Without what numba reads of the kernels that it compiled and kept itself."""
    return [line for line in lines if not (" pickle " in line and KERNELS in line.rpartition(" by ")[2].replace(os.sep, "/"))]


def test_commands_need_no_network_and_no_pickle(tmp_path):
    assert foreign(asked_by(DO + COMMANDS, tmp_path)) == []
    assert (tmp_path / "demo").is_dir()


def test_teachers_and_encoders_need_no_network_and_no_pickle(tmp_path):
    write_model(tmp_path / "model", "clip")
    assert foreign(asked_by(DO + TEACHERS, tmp_path)) == []


def test_the_window_needs_no_network_and_no_pickle(tmp_path):
    assert foreign(asked_by(DO + WINDOW, tmp_path)) == []


@pytest.mark.parametrize("reader", ["pickle", "_pickle", "torch"])
def test_pickles_are_seen(reader, tmp_path):
    code = {
        "pickle": "import pickle, fractions; pickle.loads(pickle.dumps(fractions.Fraction(1)))",
        "_pickle": "import pickle, fractions; pickle._loads(pickle.dumps(fractions.Fraction(1)))",
        "torch": "import torch, fractions; torch.save(fractions.Fraction(1), folder / 'a'); torch.load(folder / 'a', weights_only=False)",
    }
    assert any("pickle fractions.Fraction by" in line for line in foreign(asked_by(code[reader], tmp_path)))


def test_attempts_are_seen_also_of_processes_that_are_started(tmp_path):
    attempts = asked_by(ATTEMPT, tmp_path)
    assert len(attempts) == 2
    assert len({line.split()[0] for line in attempts}) == 2
