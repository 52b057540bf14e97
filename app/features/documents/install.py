"""Opening and saving: files, recent files, autosave, recovery, and the facts of what is open."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtWidgets import QMenu

from degense.app.features.documents.autosave import Autosave
from degense.app.features.documents.controller import Documents
from degense.app.features.viewer.controller import WELCOME, Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    session, autosave = shell.session, Autosave(shell)
    documents, menu = Documents(shell, autosave), ("File",)

    def movable() -> bool:
        return session.store.folder is not None and session.dirty and not session.store.elsewhere

    shell.provide(autosave)
    shell.provide(documents)
    if viewer := shell.service(Viewer):
        documents.loading.connect(lambda name: viewer.set_message(f"Opening {name} …"))
        documents.failed.connect(viewer.set_message)
        documents.stopped.connect(lambda: viewer.set_message(WELCOME))
    shell.add_actions(
        Action("file.open-clip", "Open clip…", documents.ask_for_clip, menu, ("Ctrl+O",), help="folder with frames"),
        Action("file.open-video", "Open video…", documents.ask_for_video, menu, help="clip from a movie file"),
        Action("file.open-run", "Open run…", documents.ask_for_run, menu, ("Ctrl+R",), help="reconstruction scene"),
        Action("file.demo", "Demo", documents.open_demo, menu, help="sample example"),
        Action("file.save-elsewhere", "Save elsewhere…", autosave.save_elsewhere, menu, (), movable, group=1, help="another folder disk"),
        Action("file.close", "Close", documents.close, menu, ("Ctrl+W",), lambda: session.frames > 0),
        Action("file.save", "Save view", autosave.save, menu, ("Ctrl+S",), lambda: session.frames > 0 and session.dirty, group=1),
    )
    shell.started.connect(lambda: _add_recent(shell, documents))


def _add_recent(shell: Shell, documents: Documents) -> None:
    """File ▸ Recent, filled when it is shown."""
    recent = QMenu("Recent", shell)
    shell.menus.menu(("File",)).insertMenu(shell.menus.actions["file.demo"], recent)

    def fill() -> None:
        recent.clear()
        for text in shell.settings.value.recent:
            recent.addAction(text, partial(documents.open_path, Path(text)))
        if not shell.settings.value.recent:
            recent.addAction("Nothing yet").setEnabled(False)

    recent.aboutToShow.connect(fill)
