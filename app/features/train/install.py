"""Training: the dialog, the queue, the process beside the window, and the monitor."""

from __future__ import annotations

from degense.app.features.train.controller import Training
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    shell.worker.add_channel("observed", 65)
    session, training = shell.session, Training(shell)
    shell.provide(training)

    def paused() -> bool:
        return training.queue.paused is not None

    shell.add_actions(
        Action("train.start", "Start…", training.ask, ("Train",), ("Ctrl+T",), lambda: session.clip is not None, help="queue train"),
        Action("train.resume", "Resume a stopped training…", training.ask_to_resume, ("Train",)),
        Action("train.pause", "Pause", training.pause, ("Train",), (), lambda: training.running, group=1, help="hold training"),
        Action("train.resume-paused", "Resume", training.resume_paused, ("Train",), (), paused, group=1, help="resume paused training"),
        Action(
            "train.cancel", "Cancel", training.cancel, ("Train",), (), lambda: training.running or paused(), group=1, help="stop training"
        ),
    )
