"""A tiny real clip and run, and the real window on them."""

from __future__ import annotations

import gc
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.app import installed as on

RUN_ARGUMENTS = ("--preset", "quick", "--iterations", "60", "--max-gaussians", "1500", "--device", "cpu")


@pytest.fixture(autouse=True, scope="session")
def light_collections() -> Iterator[None]:
    """Keep the garbage collector out of the modules of torch and VTK: the check for leftovers collects twice a test, half a second each."""
    import pyvista  # noqa: F401
    import torch  # noqa: F401

    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.fixture(autouse=True)
def waits_for_saves(monkeypatch) -> None:
    """What is saved is saved when that returns, however slow the disk of this machine is."""
    monkeypatch.setattr("degense.app.features.documents.saver.PATIENCE", 60.0)


@pytest.fixture(scope="session")
def tiny_clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A phantom of 10 frames, 96 × 80."""
    from degense.engine.data.synthetic import PhantomOptions, make_phantom

    folder = tmp_path_factory.mktemp("phantom") / "clip"
    make_phantom(folder, PhantomOptions(frames=10, width=96, height=80, seed=3), lambda fraction, message: None)
    return folder


@pytest.fixture(scope="session")
def trained(tiny_clip: Path) -> Path:
    """The run that `degense train` makes of it. Shared: tests work on copies."""
    from degense.app.cli.main import main

    run = tiny_clip.parent / "run"
    assert main(["train", str(tiny_clip), "--out", str(run), *RUN_ARGUMENTS]) == 0
    return run


@pytest.fixture
def run(trained: Path) -> Iterator[Path]:
    """A copy of the run beside the clip, so that the clip is found."""
    copy = trained.with_name("copy")
    shutil.copytree(trained, copy)
    yield copy
    shutil.rmtree(copy)


@pytest.fixture
def scene(run: Path):
    from degense.engine.scene import Scene

    return Scene.open(run, device="cpu")


@pytest.fixture
def window(qtbot, qapp, tmp_path: Path):
    """The window, empty and on the screen, with its 3D view."""
    from degense.app.application import FEATURES
    from degense.app.shell.settings import SettingsFile
    from degense.app.shell.shell import Shell
    from degense.widgets.theme import apply_theme

    apply_theme(qapp, "dark")
    window = Shell(SettingsFile(tmp_path / "settings.json"), FEATURES)
    qtbot.addWidget(window)
    with qtbot.waitSignal(on.viewer(window).splats_added):
        window.show()
    window.activateWindow()
    return window


@pytest.fixture
def idle(qtbot, window) -> Callable[[], None]:
    """Wait until the worker has answered everything but diagnostics, which take seconds."""

    def idle() -> None:
        qtbot.waitUntil(lambda: window.worker.idle("diagnostics") and on.viewer(window).pacing.at_rest)

    return idle


@pytest.fixture
def opened(window, run: Path, idle):
    """The window with the tiny run in it."""
    on.documents(window).open_path(run)
    idle()
    assert window.session.scene is not None
    return window


@pytest.fixture
def screenshot(qtbot, tmp_path: Path) -> Callable[[object, str], Path]:
    """Save what is on the screen; kept in the folder that DEGENSE_SCREENSHOTS names."""

    def screenshot(window, name: str) -> Path:
        from PySide6.QtWidgets import QApplication

        qtbot.wait(250)
        folder = Path(os.environ.get("DEGENSE_SCREENSHOTS", tmp_path))
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{name}.png"
        assert QApplication.primaryScreen().grabWindow(window.winId()).save(str(path))
        return path

    return screenshot
