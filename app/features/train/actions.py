"""Training."""

from __future__ import annotations

from typing import TYPE_CHECKING

from degense.app.shell.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    session, training, runs = window.session, window.training, window.run_list

    def paused() -> bool:
        return training.queue.paused is not None

    registry.add(
        Action("train.start", "Start…", training.ask, ("Train",), ("Ctrl+T",), lambda: session.clip is not None, help="queue train"),
        Action("train.resume", "Resume a stopped training…", training.ask_to_resume, ("Train",)),
        Action("train.pause", "Pause", training.pause, ("Train",), (), lambda: training.running, group=1, help="hold training"),
        Action("train.go-on", "Go on", training.go_on, ("Train",), (), paused, group=1, help="resume paused training"),
        Action(
            "train.cancel", "Cancel", training.cancel, ("Train",), (), lambda: training.running or paused(), group=1, help="stop training"
        ),
        Action("train.runs", "Runs…", runs.show, ("Train",), ("Ctrl+Shift+R",), group=2, help="compare runs scores list"),
    )
