"""One start of the window, measured in a program of its own, which imports what the window does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QApplication

from degense.app.research.event_loop import painted, viewer, wait
from degense.app.shell.settings import SettingsFile
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.app.shell.shell import Shell


#: What `degense RUN` does until it has the window's parts (`app/cli`), and then what is measured.
PROGRAM = """
import sys
from degense.app.cli.main import build_parser
build_parser()
from degense.app.start_up import load_window
load_window()
from degense.app.research.window_start import show_and_tell
show_and_tell(sys.argv[1], float(sys.argv[2]))
"""


def first_frame(folder: Path, kernels: Path | None = None) -> tuple[float, float, float]:
    """Milliseconds from the start of a program of its own to its window and to its first painted frame, and of processor time till then.

    The program keeps its bytecode, as an installed one does, whatever this process was told; compiled kernels are in `kernels`.
    """
    words = [sys.executable, "-W", "ignore", "-c", PROGRAM, str(folder), repr(time.time())]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    if kernels is not None:
        environment["NUMBA_CACHE_DIR"] = str(kernels)
    result = subprocess.run(words, capture_output=True, text=True, timeout=120, env=environment)
    if result.returncode != 0:
        raise DegenseError(
            f"The window could not be started: {result.stderr.strip().splitlines()[-1] if result.stderr.strip() else 'no word'}"
        )
    shown, painted_after, processor = json.loads(result.stdout.splitlines()[-1])
    return float(shown), float(painted_after), float(processor)


def show_and_tell(folder: str, started: float) -> None:
    """Open a run as `degense RUN` does, print what `first_frame` gives, for a start at `started` (Unix time), and leave."""
    with window_on(Path(folder)) as window:
        wait(lambda: (handle := window.windowHandle()) is not None and handle.isExposed())
        shown = time.time() - started
        painted(viewer(window).panel, lambda: viewer(window).view is not None)
        print(json.dumps([1000 * shown, 1000 * (time.time() - started), 1000 * time.process_time()]))


@contextmanager
def window_on(folder: Path) -> Iterator[Shell]:
    """The window with a run being opened in it, and settings of its own."""
    import tempfile

    from degense.app.application import FEATURES
    from degense.app.features.documents.controller import Documents
    from degense.app.shell.shell import Shell
    from degense.widgets.theme import apply_theme

    app = QApplication.instance() or QApplication(["degense"])
    assert isinstance(app, QApplication)
    with tempfile.TemporaryDirectory(prefix="degense-bench-") as scratch:
        apply_theme(app, "dark")
        window = Shell(SettingsFile(Path(scratch) / "settings.json"), FEATURES)
        window.resize(1440, 900)
        window.show()
        documents = window.service(Documents)
        assert documents is not None
        documents.open_path(folder)
        try:
            yield window
        finally:
            window.close()
            window.deleteLater()
            app.sendPostedEvents(None, QEvent.Type.DeferredDelete)
