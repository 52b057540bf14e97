"""Where what goes wrong is written down: one log file for Python, Qt and crashes."""

from __future__ import annotations

import faulthandler
import logging
import sys
import threading
from collections.abc import Callable
from logging.handlers import RotatingFileHandler
from pathlib import Path
from types import TracebackType

from PySide6.QtCore import QtMsgType, qInstallMessageHandler

log = logging.getLogger("degense")

LEVELS = {
    QtMsgType.QtDebugMsg: logging.DEBUG,
    QtMsgType.QtInfoMsg: logging.INFO,
    QtMsgType.QtWarningMsg: logging.WARNING,
    QtMsgType.QtCriticalMsg: logging.ERROR,
    QtMsgType.QtFatalMsg: logging.CRITICAL,
}


def start_logging(path: Path, complain: Callable[[str], None]) -> None:
    """Send everything to the file at `path`: log records, messages of Qt, uncaught exceptions of all threads, and the stacks of a crash.

    `complain` gets a sentence for the user when an exception was not caught, in the thread that raised it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handler = RotatingFileHandler(path, maxBytes=1_000_000, backupCount=2, encoding="utf-8")
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    root = logging.getLogger()
    root.setLevel(logging.INFO)
    root.addHandler(handler)
    faulthandler.enable(open(path.with_suffix(".crash"), "a", encoding="utf-8"))  # noqa: SIM115 - open as long as the process lives
    qInstallMessageHandler(lambda kind, context, message: logging.getLogger("qt").log(LEVELS.get(kind, logging.WARNING), message))

    def uncaught(kind: type[BaseException], error: BaseException | None, trace: TracebackType | None) -> None:
        if issubclass(kind, KeyboardInterrupt):
            sys.__excepthook__(kind, error or kind(), trace)
            return
        log.critical("uncaught exception", exc_info=(kind, error or kind(), trace))
        complain(f"The program made a mistake ({kind.__name__}: {error}). Details are in {path}.")

    sys.excepthook = uncaught
    threading.excepthook = lambda args: uncaught(args.exc_type, args.exc_value, args.exc_traceback)
