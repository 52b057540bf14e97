"""Searches in the worker, and goes to the moment of a run that is opened."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject

from degense.app.features.archive.dialog import SearchDialog
from degense.app.features.archive.searching import Line, Results, search_folder
from degense.app.features.documents.controller import Documents
from degense.app.shell.shell import Shell

#: The worker's channel.
ARCHIVE = "archive"


class ArchiveSearch(QObject):
    """One search at a time; a newer one replaces it, and it stops when the dialog is closed."""

    def __init__(self, shell: Shell, documents: Documents) -> None:
        super().__init__(shell)
        self.shell, self.session, self.documents = shell, shell.session, documents
        self.folder: Path | None = None  # that was searched last
        self._wanted: tuple[Path, int] | None = None
        self.session.opened.connect(self._opened)

    def show(self) -> None:
        """The dialog, with the folder that was searched last, else that of what is open or was opened last."""
        scene = self.session.scene
        last = scene.run.path.resolve().parent if scene is not None else Path(self.shell.settings.value.last_folder or Path.home())
        dialog = SearchDialog(self.folder or last, lambda title, start: self.shell.ask_folder(title, start), self.shell)
        dialog.asked.connect(lambda folder, text, opening: self._ask(dialog, folder, text, opening))
        dialog.stopped.connect(self._stop)
        dialog.chosen.connect(self.open)
        dialog.show()

    def _ask(self, dialog: SearchDialog, folder: Path, text: str, opening: bool) -> None:
        self.folder = folder

        def progress(step: tuple[float, str]) -> None:
            self.shell.set_busy("Searching the archive", step[0])
            dialog.show_progress(f"{step[0]:.0%}, {step[1]}")

        def found(results: Results) -> None:
            self.shell.set_busy()
            dialog.show_results(results)

        def failed(message: str) -> None:
            self.shell.set_busy()
            dialog.show_failure(message)

        self.shell.submit(ARCHIVE, lambda: search_folder(folder, text, opening), found, failed, progress)

    def _stop(self) -> None:
        self.shell.worker.cancel(ARCHIVE)
        self.shell.set_busy()

    def open(self, line: Line) -> None:
        """Open a run at a moment, or go there if it is open."""
        self._wanted = (line.run.resolve(), line.moment.first)
        if not self._go():
            self.documents.open_path(line.run)

    def _opened(self) -> None:
        if self.session.scene is not None:
            self._go()
            self._wanted = None

    def _go(self) -> bool:
        scene = self.session.scene
        if scene is None or self._wanted is None or scene.run.path.resolve() != self._wanted[0]:
            return False
        self.session.pause()
        self.session.go_to(min(self._wanted[1], scene.frames - 1))
        return True
