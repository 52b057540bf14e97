"""Help: the palette, the cheat sheet, the log, diagnostics of this machine, and what this program is."""

from __future__ import annotations

import logging

from PySide6.QtCore import Signal, SignalInstance
from PySide6.QtWidgets import QPlainTextEdit

from degense.app.shell.actions import Action
from degense.app.shell.messages import show_about, show_cheat_sheet, show_text
from degense.app.shell.palette import Palette
from degense.app.shell.shell import Shell


class LogView(QPlainTextEdit):
    """What the program did: log records from all threads. Connected while it is open: `attach` and `detach`."""

    line = Signal(str)

    def __init__(self) -> None:
        super().__init__(readOnly=True, maximumBlockCount=2000, placeholderText="Nothing to tell yet.")
        self.setAccessibleName("Log")
        self.line.connect(self.appendPlainText)
        self._handler = _Handler(self.line)

    def attach(self) -> None:
        logging.getLogger().addHandler(self._handler)

    def detach(self) -> None:
        logging.getLogger().removeHandler(self._handler)


class _Handler(logging.Handler):
    def __init__(self, line: SignalInstance) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(logging.Formatter("%(asctime)s  %(levelname)-7s %(message)s", "%H:%M:%S"))
        self._line = line

    def emit(self, record: logging.LogRecord) -> None:
        self._line.emit(self.format(record))


def install(shell: Shell) -> None:
    log = LogView()
    log_dock = shell.add_dock("Log", log)
    shell.started.connect(log.attach)
    shell.closed.connect(log.detach)
    shell.worker.add_channel("diagnostics", 90)

    def show_palette() -> None:
        palette = Palette(shell.registry, shell.menus.run, shell)
        palette.show()
        palette.input.setFocus()

    def examine() -> tuple[str, bool]:
        from degense.app.diagnostics import report

        return report()

    def diagnose() -> None:
        """Examine the machine in the worker (it takes seconds), then show the report."""
        shell.run_task("diagnostics", "Examining this machine", examine, lambda result: show_text(shell, "Diagnostics", result[0]))

    def show_keys() -> None:
        show_cheat_sheet(shell, shell.registry.cheat_sheet())

    menu = ("Help",)
    shell.add_actions(
        Action("help.palette", "Find an action…", show_palette, menu, ("Ctrl+K",), help="command palette"),
        Action("help.keys", "Shortcuts", show_keys, menu, ("?",), help="cheat sheet keys"),
        Action("help.log", "Log", lambda: shell.panes.enter(log_dock), menu, group=1, help="what the program did errors"),
        Action("help.diagnostics", "Diagnostics", diagnose, menu, group=1, help="what this machine can do doctor"),
        Action("help.about", "About DeGense", lambda: show_about(shell), menu, group=1),
        Action("file.quit", "Quit", shell.close, ("File",), ("Ctrl+Q",), group=9),
    )
