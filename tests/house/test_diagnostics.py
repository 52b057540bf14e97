"""`degense doctor` tells the truth about this machine, and about worse ones."""

from __future__ import annotations

import importlib.metadata
import subprocess
import sys

import cv2
import numpy as np
import pytest
import torch

from degense.app import diagnostics
from tests.house.source import ROOT


def test_a_sound_machine(own_folders):
    text, ok = diagnostics.report()
    assert ok, text
    assert text.endswith("Nothing is missing.\nFor research; not a medical device.")
    for name, said in {"PyTorch": torch.__version__, "Packages": f"numpy {np.__version__}", "Folders": str(own_folders)}.items():
        line = next(line for line in text.splitlines() if f" {name} " in line)
        assert said in line


def test_what_is_missing_is_named(monkeypatch, tmp_path):
    requires = importlib.metadata.requires
    monkeypatch.setattr(importlib.metadata, "requires", lambda name: [*requires(name), "nobodys-package>=2.1; python_version > '3'"])
    monkeypatch.delattr(cv2, "ximgproc")  # only a benchmark uses it
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "file"))
    text, ok = diagnostics.report()
    assert not ok
    assert "To be mended: Packages, Folders." in text
    assert "pip install nobodys-package" in text


@pytest.mark.parametrize(
    ("version", "python", "refused"),
    [
        ("6.12.0", (3, 11), True),
        ("6.12.3", (3, 10), True),
        ("6.12.0", (3, 12), False),
        ("6.11.3", (3, 11), False),
        ("6.8.0", (3, 10), False),
    ],
)
def test_the_qt_that_loses_references(version, python, refused):
    problem = diagnostics.qt_problem(version, python)
    assert (problem is not None) is refused
    assert not problem or (version in problem and "PySide6-Essentials<6.12" in problem)


def test_a_display_that_cannot_be_opened(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":98765")
    monkeypatch.setenv("QT_QPA_PLATFORM", "xcb")
    finding = diagnostics.CHECKS["Qt"]()
    assert finding.state == "missing"
    assert "cannot open a window" in finding.text


def test_no_display_is_no_fault(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    finding = diagnostics.CHECKS["Qt"]()
    assert finding.state == "note"
    assert "no display" in finding.text


def test_what_vtk_logs_is_said_as_words():
    line = "\\x1b[0m\\x1b[33m2026-11-25 09:06:52.666 (   0.247s) [    7FA48D999040]    vtkX11Functions.cxx:126   WARN| No library\\x1b[0m"
    assert diagnostics._child(f"import sys; sys.exit('{line}')") == (False, "No library")


def test_it_does_not_start_a_compilation():
    """With a CUDA compiler and no GPU, importing gsplat alone would compile for minutes."""
    code = "import sys; from degense.app.diagnostics import report; report(); sys.exit('gsplat' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT).returncode == 0


@pytest.mark.parametrize(("compiled", "state"), [(True, "ok"), (False, "note")])
def test_the_kernels_of_a_gpu(monkeypatch, tmp_path, compiled, state):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path))
    if compiled:
        (tmp_path / "py311" / "gsplat_cuda").mkdir(parents=True)
        (tmp_path / "py311" / "gsplat_cuda" / "gsplat_cuda.so").touch()
    finding = diagnostics.CHECKS["gsplat"]()
    assert finding.state == state
    assert ("are compiled" in finding.text) is compiled
