"""Starting the window."""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
from pathlib import Path

from PySide6.QtCore import QCoreApplication, Qt, QTimer
from PySide6.QtWidgets import QApplication

from degense.app import warm_up
from degense.app.features.documents.controller import Documents
from degense.app.shell.logs import start_logging
from degense.app.shell.messages import show_error
from degense.app.shell.settings import SettingsFile, log_file
from degense.app.shell.shell import Shell
from degense.engine.errors import DegenseError
from degense.widgets.theme import apply_text_size, apply_theme

#: What the window can do, each in a folder of `features`. A feature finds what earlier ones provide; without any one of them the others
#: still work.
NAMES = (
    *("timeline", "viewer", "prompts", "inspect", "tracks", "measure", "events", "cameras", "documents", "history", "clip_check"),
    *("compare", "train", "runs", "archive", "annotate", "anonymise", "export", "report"),
    *("movies", "share", "welcome", "preferences", "guide", "help"),
)
#: How long after the window has come the kernels are compiled.
WARM_UP_MS = 500
FEATURES = tuple(importlib.import_module(f"degense.app.features.{name}.install").install for name in NAMES)


def run_window(path: Path | None = None) -> int:
    """Show the window, open `path` (a clip or a run) in it, and return when it is closed."""
    if sys.platform == "linux" and not any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")):
        raise DegenseError("There is no display for the window; use the other commands (degense --help), or degense demo --headless OUT.")
    QCoreApplication.setAttribute(Qt.ApplicationAttribute.AA_ShareOpenGLContexts)
    app = QApplication([sys.argv[0]])
    app.setApplicationName("degense")
    app.setApplicationDisplayName("DeGense")
    settings = SettingsFile()
    apply_theme(app, settings.value.theme)
    apply_text_size(app, settings.value.text_size)
    window = Shell(settings, FEATURES)
    start_logging(log_file(), window.complaint.emit)
    if settings.complaint:
        QTimer.singleShot(0, lambda: show_error(window, settings.complaint or ""))
    signal.signal(signal.SIGINT, lambda number, frame: QTimer.singleShot(0, window.close))  # heard at the window's next tick
    window.show()
    opener = window.service(Documents)
    if opener is not None:
        opener.start(path)
    compiling: list[subprocess.Popen[bytes]] = []
    QTimer.singleShot(WARM_UP_MS, lambda: compiling.extend(filter(None, [warm_up.start()])))
    code = app.exec()
    for process in compiling:
        process.terminate()
        process.wait()
    return code
