"""What this machine can do for DeGense, and what is missing, in plain words."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from packaging.requirements import Requirement

from degense.app.shell.settings import config_folder, log_file
from degense.engine.gpu import kernels_compiled, lacking_kernels, nvcc

#: Seconds that a check in a child process may take; drawing in software on a busy machine is slow to start.
PATIENCE = 60
ABSENT = "(not installed)"  # in place of a version
#: Colours of a terminal, and the time and place that VTK writes before its words.
LOG_SIGNS = re.compile(r"^(?:\x1b\[[\d;]*m)*(?:[^|\n]*\.cxx:\d+\s+\w+\| )?|\x1b\[[\d;]*m", re.MULTILINE)


@dataclass(frozen=True)
class Diagnosis:
    """`ok`: there; `note`: absent or slow, but one can do without; `missing`: DeGense does not work before it is mended."""

    state: Literal["ok", "note", "missing"]
    text: str


def report() -> tuple[str, bool]:
    """Examine this machine: a text for its user, and whether nothing is missing. Takes a few seconds; compiles and downloads nothing."""
    diagnoses = {name: check() for name, check in CHECKS.items()}
    missing = [name for name, diagnosis in diagnoses.items() if diagnosis.state == "missing"]
    width = max(map(len, diagnoses))
    lines = [f"DeGense {_version('degense')} on {platform.platform()}", ""]
    lines += [f"{diagnosis.state:<7}  {name:<{width}}  {diagnosis.text}" for name, diagnosis in diagnoses.items()]
    lines += ["", f"To be mended: {', '.join(missing)}." if missing else "Nothing is missing.", "For research; not a medical device."]
    return "\n".join(lines), not missing


def qt_problem(version: str, python: tuple[int, int]) -> str | None:
    """Why this PySide6 must not be used, or None. The window asks too, before it opens."""
    if version.split(".")[:2] == ["6", "12"] and python < (3, 12):
        return (
            f"PySide6 {version} on Python {python[0]}.{python[1]} ends the program after some minutes (it loses references to None); "
            "install an older one: pip install 'PySide6-Essentials<6.12'"
        )
    return None


def _processor() -> Diagnosis:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    text = f"{cores} core{'s' if cores != 1 else ''}"
    if "SC_PHYS_PAGES" in getattr(os, "sysconf_names", {}):
        text += f", {os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 2**30:.0f} GiB of memory"
    return Diagnosis("ok", text)


def _torch() -> Diagnosis:
    import torch

    if torch.cuda.is_available():
        name, memory = torch.cuda.get_device_name(), torch.cuda.get_device_properties(0).total_memory
        return Diagnosis("ok", f"{torch.__version__}, CUDA {torch.version.cuda}, {name} with {memory / 2**30:.0f} GiB")
    if torch.version.cuda:
        return Diagnosis("note", f"{torch.__version__} for CUDA {torch.version.cuda} finds no GPU that it can use: the processor does all")
    return Diagnosis("note", f"{torch.__version__} without CUDA: the processor does all; for an NVIDIA GPU install a CUDA build")


def _gsplat() -> Diagnosis:
    import torch

    version = _version("gsplat")
    # Importing gsplat compiles its kernels wherever there is a CUDA compiler, with or without a GPU: look, do not import.
    if not torch.cuda.is_available():
        return Diagnosis("note", f"{version}, not used: there is no CUDA GPU")
    if kernels_compiled():
        return Diagnosis("ok", f"{version}, its kernels are compiled")
    if toolkit := nvcc():
        return Diagnosis("note", f"{version} will compile its kernels at first use, once, with the CUDA toolkit in {toolkit}")
    return Diagnosis("note", f"{version}. {lacking_kernels()}")


def _packages() -> Diagnosis:
    """What the program is installed with on this system, extras apart."""
    required = map(Requirement, importlib.metadata.requires("degense") or ())
    wanted = [one.name for one in required if one.marker is None or one.marker.evaluate({"extra": ""})]
    absent = [package for package in wanted if _version(package) == ABSENT]
    if absent:
        return Diagnosis("missing", f"{' and '.join(absent)} not installed: pip install {' '.join(absent)}")
    return Diagnosis("ok", ", ".join(f"{package} {_version(package)}" for package in wanted))


def _video() -> Diagnosis:
    """Writes eight frames of a movie and reads them again."""
    import cv2

    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "probe.mp4")
        writer = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"mp4v"), 25.0, (64, 48))
        for shade in range(8):
            writer.write(np.full((48, 64, 3), 30 * shade, np.uint8))
        writer.release()
        reader, frames = cv2.VideoCapture(path), 0
        while reader.read()[0]:
            frames += 1
        reader.release()
    if frames != 8:
        return Diagnosis("note", "OpenCV cannot write and read .mp4 here: use folders of PNG frames")
    return Diagnosis("ok", ".mp4 is written and read")


def _qt() -> Diagnosis:
    version = _version("PySide6-Essentials")
    if problem := qt_problem(version, sys.version_info[:2]):
        return Diagnosis("missing", problem)
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return Diagnosis("note", f"{version}, but there is no display: the command line works, the window does not")
    done, said = _child("from PySide6.QtGui import QGuiApplication; print(QGuiApplication([]).platformName())")
    if not done:
        return Diagnosis("missing", f"{version} cannot open a window here: {said}")
    return Diagnosis("ok", f"{version} opens windows ({said})")


def _opengl() -> Diagnosis:
    done, said = _child(
        "from vtkmodules.vtkRenderingCore import vtkRenderWindow; import vtkmodules.vtkRenderingOpenGL2\n"
        "window = vtkRenderWindow(); window.SetOffScreenRendering(1); window.Render()\n"
        "print(window.ReportCapabilities().split('OpenGL renderer string:')[1].splitlines()[0].strip())"
    )
    if not done:
        return Diagnosis("note", f"VTK {_version('vtk')} cannot draw here: the 3D view shows no cameras, trails and lengths ({said})")
    return Diagnosis("ok", said)


def _models() -> Diagnosis:
    version = _version("transformers")
    if version == ABSENT:
        return Diagnosis("note", "transformers is not installed: the teacher vlm needs it (pip install transformers)")
    return Diagnosis("ok", f"transformers {version}: CLIP, SigLIP and CLIPSeg models on this machine can teach")


def _folders() -> Diagnosis:
    folders = (config_folder(), log_file().parent)
    for folder in folders:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            return Diagnosis("missing", f"settings and logs cannot be written: {error}")
    return Diagnosis("ok", f"settings in {folders[0]}, log in {folders[1]}")


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ABSENT


def _child(code: str) -> tuple[bool, str]:
    """Run Python code in a process of its own, for it may crash: whether it ended well, and the line that says most."""
    try:
        result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, errors="replace", timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return False, f"no answer in {PATIENCE} seconds"
    if result.returncode == 0:
        return True, result.stdout.strip()
    lines = LOG_SIGNS.sub("", result.stderr).strip().splitlines() or [f"it ended with status {result.returncode}"]
    # An exception of Python stands in the last line; Qt and OpenGL give their reason first and go on from there.
    return False, lines[-1 if lines[0].startswith("Traceback") else 0]


CHECKS: dict[str, Callable[[], Diagnosis]] = {
    "Python": lambda: Diagnosis("ok", platform.python_version()),
    "Machine": _processor,
    "PyTorch": _torch,
    "gsplat": _gsplat,
    "Packages": _packages,
    "Movies": _video,
    "Qt": _qt,
    "OpenGL": _opengl,
    "Models": _models,
    "Folders": _folders,
}
