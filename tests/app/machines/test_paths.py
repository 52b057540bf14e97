"""Spaces, letters beyond ASCII, PowerShell's signs and names that differ only in case, in the paths of every command and of the window."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from degense.app.cli.main import main
from degense.app.features.export.formats import FORMATS
from degense.app.features.export.label_dialog import LabelExportDialog
from degense.engine.annotation.formats import LABEL_FORMATS
from tests.app import installed as on
from tests.house.source import ROOT

#: Letters beyond ASCII, and the signs that PowerShell, other shells and patterns of file names read as their own.
FOLDERS = ("Größe – Óperation 手術", "a[1] $x & 'y' `z`; (b) {c} 100% #d!")
#: Those that know the classes of one data set alone.
READ_ONLY = {"cholecseg8k", "endovis18"}
TINY = ("--preset", "quick", "--iterations", "20", "--max-gaussians", "300", "--device", "cpu")


@pytest.fixture(scope="module", params=FOLDERS, ids=["letters", "signs"])
def home(request, tmp_path_factory) -> Path:
    """A folder with such a name, with a clip and its run in folders with such names."""
    home = tmp_path_factory.mktemp("paths") / request.param
    clip, run = home / "Süß clip 日本", home / "Läufe" / "erster Lauf №1"
    assert main(["phantom", str(clip), "--frames", "4", "--size", "48x40", "--seed", "3"]) == 0
    assert main(["train", str(clip), "--out", str(run), *TINY]) == 0
    return home


@pytest.fixture
def clip(home) -> Path:
    return home / "Süß clip 日本"


@pytest.fixture
def trained(home) -> Path:
    """In place of that of the other tests."""
    return home / "Läufe" / "erster Lauf №1"


def does(*words: object) -> None:
    assert main([str(word) for word in words]) == 0, words


def test_a_process_in_the_language_c(home, clip):
    """Without a locale, as services and job arrays start programs; and what is printed names the folder."""
    environment = {**os.environ, "LC_ALL": "C", "LANG": "C"}
    told = subprocess.run([sys.executable, "-m", "degense.app", "info", str(clip)], cwd=ROOT, env=environment, capture_output=True)
    assert told.returncode == 0, told.stderr
    assert "Süß clip 日本" in told.stdout.decode("utf-8")
    told = subprocess.run([sys.executable, "-m", "degense.app", "info", str(home / "nö")], cwd=ROOT, env=environment, capture_output=True)
    assert told.returncode == 2
    assert "nö" in told.stderr.decode("utf-8")
    assert b"Traceback" not in told.stderr


@pytest.mark.parametrize("name", sorted(set(FORMATS) - READ_ONLY))
def test_exports(name, trained, home):
    out = home / f"Ausgabe {name} é{FORMATS[name].suffix}"
    does("export", trained, "--format", name, "--out", out)
    assert out.exists()


@pytest.mark.parametrize("name", sorted(set(LABEL_FORMATS) - READ_ONLY))
def test_imports(name, home, tmp_path):
    """What was exported comes back, into a clip in such a folder."""
    out = home / f"Rückweg {name}{LABEL_FORMATS[name].suffix}"
    does("export", home / "Süß clip 日本", "--format", name, "--out", out)
    other = tmp_path / home.name / "clip"
    shutil.copytree(home / "Süß clip 日本", other)
    does("import", other, out, "--format", name)


def test_pictures_masks_questions_movies_and_pages(trained, home):
    does("render", trained, "--frame", 1, "--out", home / "Bild ä.png")
    does("render", trained, "--frames", "0:2", "--layer", "depth", "--out", home / "Tiefe ö.npy")
    does("render", trained, "--frames", "0:2", "--out", home / "Bilder ü")
    does("segment", trained, "--prompt", "liver", "--frames", "all", "--out", home / "Masken ß")
    does("query", trained, "liver", "--json", home / "Antwort é.json")
    does("movie", trained, "--out", home / "Film 映画.mp4")
    does("share", trained, "--out", home / "Seite ñ.html")
    does("track", trained, "--grid", 2, "--json", home / "Punkte č.json")
    (home / "Punkte č.csv").write_text("frame,x,y\n0,20,20\n", encoding="utf-8")
    does("track", trained, "--points", home / "Punkte č.csv")
    labels = home / "Süß clip 日本" / "labels" / "000000.png"
    does("annotate", trained, "--labels", labels, "--frame", 0, "--out", home / "Übertragen ō")
    does("eval", trained, "--json", home / "Maße.json", "--report", home / "Bericht å")
    made = ("Bild ä.png", "Tiefe ö.npy", "Bilder ü/000001.png", "Film 映画.mp4", "Seite ñ.html", "Maße.json", "Bericht å/report.html")
    assert [name for name in made if not (home / name).is_file()] == []
    assert json.loads((home / "Antwort é.json").read_text(encoding="utf-8"))


def test_a_batch_and_a_search(home, clip, tmp_path, capsys):
    """The plan is a file; two clips whose names differ only in case get runs that no system mistakes for each other."""
    for name in ("Galle É", "galle é"):
        shutil.copytree(clip, tmp_path / home.name / name[:5] / name)
    clips = ", ".join(json.dumps(str(path), ensure_ascii=False) for path in sorted((tmp_path / home.name).glob("?alle/*")))
    plan = tmp_path / home.name / "Plan ü.toml"
    plan.write_text(
        f'clips = [{clips}]\npreset = "quick"\niterations = 20\nmax_gaussians = 200\ndevice = "cpu"\nexports = ["coco"]\nscores = false\n',
        encoding="utf-8",
    )
    out = tmp_path / home.name / "Stapel 一"
    does("batch", plan, "--out", out, "--slots", 1)
    runs = sorted(path.name for path in (out / "runs").iterdir())
    assert len({name.casefold() for name in runs}) == len(runs) == 2
    assert len({path.name.casefold() for path in (out / "exports").rglob("*.json")}) == 2
    capsys.readouterr()
    does("search", out / "runs", "liver")
    said = capsys.readouterr().out
    assert all(name in said for name in runs)


def test_other_trainings_and_what_lists_and_checks(home, clip, trained, tmp_path, capsys):
    """Resumed, compared, listed, summed and taken away; and the words that a plan and a job array are given."""
    out = tmp_path / home.name
    does("train", clip, "--out", out / "run", *TINY)
    does("compare", clip, "--out", out / "compared", "--methods", "dgd", *TINY)
    does("checksum", out / "run")
    does("checksum", out / "run", "--check")
    does("info", clip)
    capsys.readouterr()
    does("datasets", home)
    assert clip.name in capsys.readouterr().out
    does("demo", "--headless", out / "demo")
    does("batch", clip, "--out", out / "batch", *TINY, "--slots", 1, "--no-eval", "--export", "coco", "--emit", "slurm", out / "array.sh")
    assert subprocess.run(["bash", "-n", str(out / "array.sh")]).returncode == 0
    does("batch", "--out", out / "batch")
    assert len(list((out / "batch" / "exports" / "coco").iterdir())) == 1
    does("search", out / "batch" / "runs", "liver", "--json", out / "said.json", "--thumbnails", out / "pictures")
    assert any((out / "pictures").iterdir())


def test_the_window(qtbot, window, home, trained, idle, screenshot):
    on.documents(window).open_path(trained)
    idle()
    assert window.session.clip is not None
    assert "erster Lauf №1" in window.windowTitle()
    window.session.view.add_prompt("liver")
    idle()
    window.registry.run("file.save")
    idle()
    assert (trained / "session.json").is_file()
    QTest.keyClick(window, Qt.Key.Key_E, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier)
    dialog = window.findChild(LabelExportDialog)
    dialog.path.line.setText(str(home / "Fenster ł.json"))
    dialog.format.setCurrentIndex(dialog.format.findData("coco"))
    dialog.path.line.setText(str(home / "Fenster ł.json"))
    QTest.mouseClick(dialog.start, Qt.MouseButton.LeftButton)
    idle()
    assert json.loads((home / "Fenster ł.json").read_text(encoding="utf-8"))["images"]
    on.reporter(window).export(home / "Bericht ø.html")
    on.exporter(window).save_frame(home / "Bild ő.png")
    idle()
    assert (home / "Bericht ø.html").is_file()
    assert (home / "Bild ő.png").is_file()
    screenshot(window, "paths")


def test_pictures_are_never_read_or_written_by_opencv_itself():
    """On Windows its `imread` and `imwrite` take paths in the code page of the system alone; bytes are encoded and decoded instead."""
    calls = re.compile(r"cv2\.im(?:read|write)\(")
    files = [path for room in ("engine", "app", "widgets") for path in (ROOT / room).rglob("*.py") if "reliability" not in path.parts]
    assert [path.relative_to(ROOT).as_posix() for path in files if calls.search(path.read_text(encoding="utf-8"))] == []
    assert np.asarray(files).size > 300
