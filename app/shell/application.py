"""Starting the window."""

from __future__ import annotations

import os
import signal
import socket
import sys
from pathlib import Path

from PySide6.QtCore import QCoreApplication, QObject, QSocketNotifier, Qt, QTimer
from PySide6.QtWidgets import QApplication

from degense.app.shell.logs import start_logging
from degense.app.shell.main_window import MainWindow
from degense.app.shell.messages import show_error
from degense.app.shell.settings import SettingsFile, log_file
from degense.engine.errors import DegenseError
from degense.widgets.theme import apply_theme


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
    window = MainWindow(settings)
    start_logging(log_file(), window.complaint.emit)
    if settings.complaint:
        QTimer.singleShot(0, lambda: show_error(window, settings.complaint or ""))
    InterruptWatch(window)
    window.show()
    path = path or window.keeping.left_behind()
    if path is not None:
        window.opening.open_path(path)
    return app.exec()


class InterruptWatch(QObject):
    """Closes the window on Ctrl-C in the terminal. Qt's loop runs no Python by itself; the wake-up descriptor makes it."""

    def __init__(self, window: MainWindow) -> None:
        super().__init__(window)
        self._ours, theirs = socket.socketpair()
        for end in (self._ours, theirs):
            end.setblocking(False)
        self._theirs = theirs
        signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGINT, lambda number, frame: None)
        self._notifier = QSocketNotifier(self._ours.fileno(), QSocketNotifier.Type.Read, self)
        self._notifier.activated.connect(lambda: (self._ours.recv(64), window.close()))
