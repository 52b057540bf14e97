"""Undo, redo, and the list of what was done."""

from __future__ import annotations

from degense.app.features.history.panel import HistoryList
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    undo, history = shell.session.undo, HistoryList()
    history.position_chosen.connect(undo.go_to)
    undo.changed.connect(lambda: history.set_entries(undo.entries, undo.position))
    dock = shell.add_dock("History", history)
    menu = ("Edit",)
    shell.add_actions(
        Action("edit.undo", "Undo", undo.undo, menu, ("Ctrl+Z",), lambda: undo.undo_name is not None),
        Action("edit.redo", "Redo", undo.redo, menu, ("Ctrl+Shift+Z", "Ctrl+Y"), lambda: undo.redo_name is not None),
        Action("edit.history", "History", lambda: shell.docks.bring(dock), menu, ("Ctrl+H",), help="list of edits undo"),
    )
