"""Prompts asked of the whole clip."""

from __future__ import annotations

from typing import TYPE_CHECKING

from degense.app.shell.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    querying, menu = window.querying, ("Inspect",)
    registry.add(
        Action(
            "query.clip", "Query whole clip", querying.ask, menu, ("Q",), querying.can_ask, group=3, help="prompts area over time masks"
        ),
        Action(
            "query.save",
            "Query whole clip into a folder…",
            querying.ask_for_folder,
            menu,
            (),
            querying.can_ask,
            group=3,
            help="prompts label maps masks segment",
        ),
        Action("query.stop", "Stop the query", querying.stop, menu, (), lambda: querying.running, group=3, help="cancel prompts"),
    )
