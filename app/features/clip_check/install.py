"""Checking a clip on its frames before anything is made of it."""

from __future__ import annotations

from degense.app.features.clip_check.check_dialog import CheckDialog
from degense.app.features.documents.controller import Documents
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    documents, session = shell.service(Documents), shell.session
    if documents is None:
        return
    shell.worker.add_channel("check-frame", 10)
    shell.worker.add_channel("check", 11)

    def possible() -> bool:
        return session.scene is None and session.clip is not None

    def check() -> None:
        """Show what was found in the open clip on its frames, and open it again with the answers."""
        clip = session.clip
        if clip is None or not possible():
            return
        dialog = CheckDialog(clip.path, clip, documents.clip_options, shell.worker, shell)

        def use() -> None:
            if dialog.answers != documents.clip_options:
                documents.open_path(clip.path, dialog.answers)

        dialog.accepted.connect(use)
        dialog.open()

    documents.facts.check_requested.connect(check)
    documents.clip_opened.connect(lambda chosen: check() if chosen else None)
    shell.add_actions(
        Action("file.check", "Check the clip…", check, ("File",), ("Ctrl+I",), possible, help="import masks focal length poses depth")
    )
