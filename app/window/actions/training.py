"""Training."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from app.window.main import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    session, training = window.session, window.training
    registry.add(
        Action("train.start", "Start…", training.ask, ("Train",), ("Ctrl+T",), lambda: session.clip is not None and not training.running),
        Action("train.resume", "Resume a stopped training…", training.ask_to_resume, ("Train",), (), lambda: not training.running),
        Action("train.cancel", "Cancel", training.cancel, ("Train",), (), lambda: training.running, group=1, help="stop training"),
    )
