"""Finding out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from degense.app.shell.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    helping = window.helping
    registry.add(
        Action("help.palette", "Find an action…", helping.show_palette, ("Help",), ("Ctrl+K",), help="command palette"),
        Action("help.keys", "Shortcuts", helping.show_cheat_sheet, ("Help",), ("?",), help="cheat sheet keys"),
        Action("help.layers", "What the layers show", helping.show_layers, ("Help",), ("F1",), help="formula units meaning"),
        Action("help.log", "Log", helping.show_log, ("Help",), (), group=1, help="what the program did errors"),
        Action("help.doctor", "Doctor", helping.show_doctor, ("Help",), (), group=1, help="what this machine can do"),
        Action("help.about", "About DeGense", helping.show_about, ("Help",), (), group=1),
    )
