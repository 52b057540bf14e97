"""Undo, redo and writing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from degense.app.shell.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    undo = window.session.undo

    registry.add(
        Action("edit.undo", "Undo", undo.undo, ("Edit",), ("Ctrl+Z",), lambda: undo.undo_name is not None),
        Action("edit.redo", "Redo", undo.redo, ("Edit",), ("Ctrl+Shift+Z", "Ctrl+Y"), lambda: undo.redo_name is not None),
        Action("edit.history", "History", window.show_history, ("Edit",), ("Ctrl+H",), help="list of edits undo"),
        Action(
            "edit.prompt",
            "Write a prompt",
            window.focus_prompt,
            ("Edit",),
            ("/",),
            lambda: window.session.scene is not None,
            group=1,
            help="search mask",
        ),
        Action(
            "edit.preferences", "Preferences…", window.preferring.show, ("Edit",), ("Ctrl+,",), group=9, help="settings shortcuts theme"
        ),
    )
