"""What every test stands on: settings of its own, few threads, no unexplained skips, nothing of Qt left behind."""

from __future__ import annotations

import functools
import gc
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

# Read when torch and numba are imported. Two, so that threads really run, and results and timings do not depend on the machine's size.
os.environ.setdefault("OMP_NUM_THREADS", "2")
os.environ.setdefault("NUMBA_NUM_THREADS", "2")

ROOT = Path(__file__).resolve().parent.parent

#: A test may be skipped only for a reason that begins with one of these. Every other skip fails: it would hide a test that nobody runs.
ALLOWED_SKIPS = (
    "needs CUDA",
    "needs Chromium",
    "needs distributed",
    "needs sha256sum",
    "needs ssh-keygen",
    "needs strace",
    "real clips absent",
    "the superuser may read everything",
)

# Shapes that the engine states with jaxtyping are checked at every call. Only there: wrapped functions are lost to numba's compiler.
install_import_hook(
    [
        ".".join(("degense", *path.relative_to(ROOT).with_suffix("").parts))
        for path in (ROOT / "engine").rglob("*.py")
        if re.search(r"^(from|import) jaxtyping\b", path.read_text(encoding="utf-8"), re.MULTILINE)
    ],
    "beartype.beartype",
)

# The same examples in every run, however long one takes on a busy machine.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

_passed = pytest.StashKey[bool]()


@pytest.fixture(autouse=True)
def same_seed() -> None:
    """What a test draws from torch without a seed does not depend on the tests before it."""
    if torch := sys.modules.get("torch"):
        torch.manual_seed(0)


@pytest.fixture(autouse=True)
def own_folders(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Settings, caches and logs go to a fresh folder, never to the user's."""
    home = tmp_path_factory.mktemp("home")
    for variable in ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "XDG_STATE_HOME", "APPDATA", "LOCALAPPDATA"):
        monkeypatch.setenv(variable, str(home / variable.lower()))
    if settings := getattr(sys.modules.get("PySide6.QtCore"), "QSettings", None):
        for file_format in (settings.Format.NativeFormat, settings.Format.IniFormat):
            settings.setPath(file_format, settings.Scope.UserScope, str(home))
    return home


@pytest.fixture
def qtbot(qtbot, monkeypatch: pytest.MonkeyPatch):
    """pytest-qt's, more patient: a wait ends when what it waits for has happened, and a busy machine may stand still for seconds."""
    for name in ("waitUntil", "waitSignal"):
        monkeypatch.setattr(qtbot, name, functools.partial(getattr(qtbot, name), timeout=120_000))
    return qtbot


@pytest.fixture(scope="session")
def clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the real clips, unpacked: `pulling`, `cholec160`, `pulling.mp4`, the first as it was packed, and what else there is.

    They come from the folder that DEGENSE_CLIPS names, else from `shared/clips` beside the project.
    A test that asks for this fixture is marked `real_clips`; without the clips it is skipped.
    """
    packed = Path(os.environ.get("DEGENSE_CLIPS", ROOT.parent / "shared" / "clips"))
    if not (packed / "unpack").is_file():
        pytest.skip("real clips absent: DEGENSE_CLIPS names no folder of them, and shared/clips does not lie beside the project")
    folder = tmp_path_factory.mktemp("clips")
    subprocess.run([sys.executable, str(packed / "unpack"), str(folder)], check=True, stdout=subprocess.DEVNULL)
    shutil.copy(packed / "pulling" / "clip.mp4", folder / "pulling.mp4")
    return folder


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "real_clips: needs the real clips, which do not come with the project")
    config.addinivalue_line("markers", "cuda: needs a GPU, and is skipped without one")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the tests that need the real clips, before any are chosen by their marks; skips those that need a GPU where there is none."""
    for item in items:
        if "clips" in getattr(item, "fixturenames", ()):
            item.add_marker("real_clips")
        if item.get_closest_marker("cuda") and not _has_gpu():
            item.add_marker(pytest.mark.skip(reason="needs CUDA"))


@functools.cache
def _has_gpu() -> bool:
    import torch

    return torch.cuda.is_available()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log):
    """One process takes every test with a window, the others the folders that need no screen, and who is done first takes what is left."""
    from xdist.scheduler import LoadScopeScheduling

    class ByScreen(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            room, of = nodeid.split("/")[1:3]
            with_windows = room == "widgets" or (room == "app" and of not in ("headless", "interop", "batch", "reliability"))
            return "window" if with_windows else f"{room}/{of}" if room == "app" else room

    return ByScreen(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report = yield
    if report.when == "call":
        item.stash[_passed] = report.passed
    return _explained(report)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Iterator[None]:
    return _explained((yield))


def _explained(report):
    """The report itself, or a failure where a test was skipped for a reason that is not allowed."""
    if report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2].removeprefix("Skipped: ") if isinstance(report.longrepr, tuple) else str(report.longrepr)
        if not reason.startswith(ALLOWED_SKIPS):
            report.outcome = "failed"
            report.longrepr = (
                f"skipped for a reason that is not allowed ({reason!r}); allowed reasons begin with {' or '.join(ALLOWED_SKIPS)}"
            )
    return report


@pytest.fixture(autouse=True)
def nothing_left_behind(request: pytest.FixtureRequest) -> Iterator[None]:
    """Tests of the window leave no running thread, active timer, running process or living top-level widget.

    A failed test is not checked: its traceback keeps its objects alive.
    """
    if not re.search(r"/tests/(widgets|app)/(?!headless/)", request.node.path.as_posix()):
        yield
        return
    before = _living()
    yield
    if request.node.stash.get(_passed, False) and _living().keys() - before.keys():
        gc.collect()  # which takes longer than many a test
        left = {key: text for key, text in _living().items() if key not in before}
        assert not left, f"left behind: {', '.join(left.values())}"


def _living() -> dict[int, str]:
    """What of Qt is alive and would outlive a test, by identity."""
    if "PySide6.QtWidgets" not in sys.modules:
        return {}
    import shiboken6
    from PySide6.QtCore import QCoreApplication, QEvent, QProcess, QThread, QTimer
    from PySide6.QtWidgets import QApplication, QWidget

    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
    alive: dict[type, Callable[..., bool]] = {
        QThread: lambda thread: thread.isRunning() and thread is not QThread.currentThread(),
        QTimer: lambda timer: timer.isActive(),
        QProcess: lambda process: process.state() != QProcess.ProcessState.NotRunning,
        QWidget: lambda widget: widget.isWindow() and widget.parent() is None,
    }
    QApplication.topLevelWidgets()  # gives Python names to those that only C++ knows
    return {
        id(thing): f"{type(thing).__name__} {thing.objectName()!r}"
        for thing in shiboken6.getAllValidWrappers()
        for kind, lives in alive.items()
        if isinstance(thing, kind) and lives(thing)
    }
