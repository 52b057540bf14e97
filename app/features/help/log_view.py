"""The log as a dock: what the program did, for those who want to know."""

from __future__ import annotations

import logging

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QPlainTextEdit, QWidget


class _Relay(QObject):
    line = Signal(str)


class LogView(QPlainTextEdit):
    """Shows log records from all threads. Connected while it is open: `attach` and `detach`."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setReadOnly(True)
        self.setAccessibleName("Log")
        self.setMaximumBlockCount(2000)
        self._relay = _Relay(self)
        self._relay.line.connect(self.appendPlainText)
        self._handler = _Handler(self._relay)

    def attach(self) -> None:
        logging.getLogger().addHandler(self._handler)

    def detach(self) -> None:
        logging.getLogger().removeHandler(self._handler)


class _Handler(logging.Handler):
    def __init__(self, relay: _Relay) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(logging.Formatter("%(asctime)s  %(levelname)-7s %(message)s", "%H:%M:%S"))
        self._relay = relay

    def emit(self, record: logging.LogRecord) -> None:
        self._relay.line.emit(self.format(record))
