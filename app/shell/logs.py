"""Where what goes wrong is written down: one log file for Python, Qt and crashes."""

from __future__ import annotations

import faulthandler
import hashlib
import logging
import re
import secrets
import sys
import threading
from collections.abc import Callable
from logging.handlers import RotatingFileHandler
from pathlib import Path
from types import TracebackType

from PySide6.QtCore import QtMsgType, qInstallMessageHandler

log = logging.getLogger("degense")

PROGRAM = Path(__file__).resolve().parents[2]

LEVELS = {
    QtMsgType.QtDebugMsg: logging.DEBUG,
    QtMsgType.QtInfoMsg: logging.INFO,
    QtMsgType.QtWarningMsg: logging.WARNING,
    QtMsgType.QtCriticalMsg: logging.ERROR,
    QtMsgType.QtFatalMsg: logging.CRITICAL,
}


#: Folders and files that were opened; what they are called may say who is operated on.
_hidden: set[Path] = set()
#: Names shorter than this are words of the program as well.
SHORTEST = 4
#: Drawn anew in each process: what is hidden has the same sign in all lines of a session, and nobody finds the name by trying names.
_KEY = secrets.token_bytes(16)
_ABSOLUTE = re.compile(r"(?<![\w.~/])(?:/|[A-Za-z]:[\\/])(?:[^\s'\":;,|<>()]+[\\/])+[^\s'\":;,|<>()]+")


def hide_names(*paths: Path) -> None:
    """Keep these paths, and the names of their last two folders or files, out of the log from now on."""
    _hidden.update(path for path in paths if path.name)


class NamelessFormatter(logging.Formatter):
    """Writes a sign for each path in a line, apart from those of the program itself; tracebacks too."""

    def format(self, record: logging.LogRecord) -> str:
        return nameless(super().format(record))


def nameless(text: str) -> str:
    """A text without paths that were opened, their names, and what else looks like a path of this machine."""
    for path in sorted(_hidden, key=lambda path: -len(str(path))):
        for words in dict.fromkeys((str(path.resolve()), str(path), path.as_posix(), path.name, path.parent.name)):
            if len(words) >= SHORTEST:
                text = re.sub(rf"(?<!\w){re.escape(words)}(?!\w)", _sign(words), text)
    return _ABSOLUTE.sub(lambda found: found[0] if _of_the_program(found[0]) else _sign(found[0]), text)


def _sign(words: str) -> str:
    return f"<name {hashlib.blake2b(words.encode(), key=_KEY, digest_size=4).hexdigest()}>"


def _of_the_program(path: str) -> bool:
    return Path(path).is_relative_to(PROGRAM) or Path(path).is_relative_to(sys.prefix) or Path(path).is_relative_to(sys.base_prefix)


def start_logging(path: Path, complain: Callable[[str], None]) -> None:
    """Send everything to the file at `path`, without names (`hide_names`): log records, messages of Qt, uncaught exceptions of all threads,
    and the stacks of a crash.

    `complain` gets a sentence for the user when an exception was not caught, in the thread that raised it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handler = RotatingFileHandler(path, maxBytes=1_000_000, backupCount=2, encoding="utf-8")
    handler.setFormatter(NamelessFormatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
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
