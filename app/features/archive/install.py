"""A question to all runs of a folder; a moment that is found opens its run there."""

from __future__ import annotations

from degense.app.features.archive.controller import ARCHIVE, ArchiveSearch
from degense.app.features.documents.controller import Documents
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    documents = shell.service(Documents)
    if documents is None:
        return
    shell.worker.add_channel(ARCHIVE, 82)
    archive = ArchiveSearch(shell, documents)
    shell.provide(archive)
    shell.add_actions(
        Action("file.search", "Search archive…", archive.show, ("File",), ("Ctrl+Shift+F",), help="find runs folder questions moments"),
    )
