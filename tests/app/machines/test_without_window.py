"""Where Qt and VTK are not installed, batches and benchmarks work: only what shows a window needs them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.house.source import imports, modules, within

ABSENT = ("PySide6", "shiboken6", "pyqtgraph", "pyvista", "vtk", "vtkmodules")
#: They show a window.
IN_A_WINDOW = ("degense.app.research.reliability.soak", "degense.app.research.reliability.stalled_work", "degense.app.application")


@pytest.fixture
def python(tmp_path):
    """Run Python where those packages cannot be imported, nor by processes that it starts."""
    absent = tmp_path / "absent"
    absent.mkdir()
    for name in ABSENT:
        (absent / f"{name}.py").write_text(f'raise ModuleNotFoundError("No module named {name}", name="{name}")\n', encoding="utf-8")
    paths = [str(absent), *filter(None, [os.environ.get("PYTHONPATH")])]

    def python(*words: str | Path) -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
        return subprocess.run([sys.executable, *map(str, words)], cwd=tmp_path, env=environment, capture_output=True, text=True)

    return python


@pytest.mark.parametrize("name", ABSENT)
def test_they_are_absent_there(python, name):
    assert f"ModuleNotFoundError: No module named {name}" in python("-c", f"import {name}").stderr


def test_what_needs_no_window_is_imported(python):
    """With all that these import when they are called."""
    packages = ("degense.app.cli", "degense.app.batch", "degense.app.research.reliability", "degense.app.research.batch_bench")
    known = {".".join(("degense", *path.with_suffix("").parts)).removesuffix(".__init__"): path for path in modules("app", "engine")}
    chosen = {name for name in known if within(name, packages) and not within(name, IN_A_WINDOW)}
    later = {name.rpartition(".")[0] for module in chosen for _, name in imports(known[module])}
    called = {name for name in (chosen | later) & {*known} if not within(name, IN_A_WINDOW)}
    assert len(called) > 100
    imported = python("-c", "import importlib, sys\nfor name in sys.argv[1:]: importlib.import_module(name)", *sorted(called))
    assert imported.returncode == 0, imported.stderr


def test_a_batch_trains_asks_and_exports(python, tiny_clip, tmp_path):
    short = ("--preset", "quick", "--iterations", "60", "--max-gaussians", "400", "--device", "cpu", "--set", "semantic_steps=10")
    asked = ("--prompt", "liver", *(word for name in ("ply", "coco", "movie") for word in ("--export", name)))
    done = python("-m", "degense.app", "batch", tiny_clip, "--out", "out", *short, *asked)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {path.parent.name for path in (tmp_path / "out/exports").glob("*/*")} == {"ply", "coco", "movie"}


def test_a_movie_of_another_size_is_drawn(python, run, tmp_path):
    done = python("-m", "degense.app", "movie", run, "--size", "64x64", "--out", "movie.mp4")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "movie.mp4").is_file()


def test_the_campaign_is_asked_for(python):
    refused = python("-m", "degense.app", "bench", "reliability", "nonsense")
    assert refused.returncode == 2, refused.stderr
    assert "There is no part 'nonsense' of the campaign" in refused.stderr
