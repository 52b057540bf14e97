"""Finding out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from app.window.main import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    registry.add(
        Action("help.palette", "Find an action…", window.show_palette, ("Help",), ("Ctrl+K",), help="command palette"),
        Action("help.keys", "Shortcuts", window.show_cheat_sheet, ("Help",), ("?",), help="cheat sheet keys"),
        Action("help.doctor", "Doctor", window.show_doctor, ("Help",), (), group=1, help="what this machine can do"),
        Action("help.about", "About DeGense", window.show_about, ("Help",), (), group=1),
    )
