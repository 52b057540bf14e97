"""The runs of a folder: their settings and scores side by side."""

from __future__ import annotations

from degense.app.features.documents.controller import Documents
from degense.app.features.runs.runs_dialog import Runs
from degense.app.features.train.controller import Training
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    documents, training = shell.service(Documents), shell.service(Training)
    if documents is None or training is None:
        return
    runs = Runs(shell, documents, training)
    shell.provide(runs)
    shell.add_actions(Action("train.runs", "Runs…", runs.show, ("Train",), ("Ctrl+Shift+R",), group=2, help="compare runs scores list"))
