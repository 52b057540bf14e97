"""Looking closely: what moved, how far, and where it moved without reason."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtWidgets import QFileDialog

from degense.app.shell.actions import Action, ActionRegistry
from degense.app.shell.messages import show_error
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    session, probing, ranking, runs = window.session, window.probing, window.ranking, window.runs

    def has_scene() -> bool:
        return session.scene is not None

    def listed() -> bool:
        return bool(ranking.findings())

    def ask(what: str, save: Callable[[Path], None]) -> None:
        kinds = "Table (*.csv);;Picture (*.png)"
        file, _ = QFileDialog.getSaveFileName(window, f"Save {what}", f"{session.name}-{what}.csv", kinds)
        if file:
            try:
                save(Path(file))
            except DegenseError as error:
                show_error(window, str(error))

    menu = ("Inspect",)
    registry.add(
        *(
            Action(
                f"inspect.{name}",
                f"Follow a region: {name}",
                partial(probing.take_tool, name),
                menu,
                (key,),
                has_scene,
                partial(probing.has_tool, name),
                help="probe curves outline",
            )
            for name, key in (("rectangle", "B"), ("lasso", "L"))
        ),
        Action(
            "inspect.mask",
            "Follow the mask of a prompt",
            probing.follow_mask,
            menu,
            ("K",),
            lambda: has_scene() and bool(session.view_state.visible_prompts),
            help="probe curves class area",
        ),
        Action("inspect.unpin", "Follow nothing", probing.unpin, menu, ("Escape",), lambda: session.probe is not None, help="probe"),
        Action(
            "inspect.save-curves",
            "Save the curves…",
            partial(ask, "curves", probing.save_curves),
            menu,
            (),
            lambda: probing.curves is not None,
            help="csv png table",
        ),
        Action("inspect.rank", "Find the worst places", ranking.search, menu, ("Shift+W",), ranking.can_search, group=1, help="ranking"),
        Action("inspect.next", "Next finding", partial(ranking.go_on, 1), menu, ("N",), listed, group=1),
        Action("inspect.previous", "Previous finding", partial(ranking.go_on, -1), menu, ("Shift+N",), listed, group=1),
        Action(
            "inspect.save-findings",
            "Save the findings…",
            partial(ask, "findings", ranking.save),
            menu,
            (),
            listed,
            group=1,
            help="csv png table sheet",
        ),
        Action("inspect.second-run", "Hold against another run…", runs.ask, menu, (), has_scene, group=2, help="compare side by side"),
        Action("inspect.one-run", "Put the other run away", runs.close, menu, (), lambda: runs.scene is not None, group=2, help="compare"),
    )
