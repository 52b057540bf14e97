"""File ▸ Export ▸ Movie, and movies along the kept cameras."""

from __future__ import annotations

from pathlib import Path

from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.anonymise.box import AnonymiseBox
from degense.app.features.cameras.controller import Cameras
from degense.app.features.movies.dialog import FLIGHT, MovieDialog
from degense.app.features.movies.movie import MovieOptions, make_movie
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell
from degense.widgets import forms


class Movies:
    """Opens the dialog, and writes movies in the worker while the window goes on; Export ▸ Stop exporting ends it."""

    def __init__(self, shell: Shell, cameras: Cameras | None) -> None:
        self._shell, self._cameras = shell, cameras

    def ask(self, along: bool = False) -> MovieDialog:
        """Open the dialog; `along` the kept cameras at first."""
        session = self._shell.session
        assert session.scene is not None
        stops = self._cameras.book.stops if self._cameras is not None else ()
        shell, box = self._shell, AnonymiseBox(self._shell)
        dialog = MovieDialog(shell, session.scene, session.view_state, stops, box, shell.ask_save, self.write)
        if along:
            forms.enter(dialog.camera, FLIGHT)
        dialog.open()
        return dialog

    def write(self, out: Path, options: MovieOptions, hidden: Anonymity) -> None:
        assert self._shell.session.scene is not None
        scene = hidden.scene(self._shell.session.scene)
        self._shell.run_task("export", f"Exporting {out.name}", lambda: make_movie(scene, out, options), detailed=True)


def install(shell: Shell) -> None:
    session, cameras = shell.session, shell.service(Cameras)
    movies = Movies(shell, cameras)
    shell.provide(movies)
    shell.add_actions(
        Action(
            "export.movie", "Movie…", movies.ask, ("File", "Export"), ("Ctrl+Alt+M",), session.has_scene, group=1, help="mp4 video layer"
        )
    )
    if cameras is not None:
        cameras.panel.movie_requested.connect(lambda: movies.ask(along=True))
        along, menu = lambda: movies.ask(along=True), ("View", "Cameras")
        shell.add_actions(
            Action("cameras.movie", "Movie along the cameras…", along, menu, (), cameras.has_path, group=1, help="export mp4 flight")
        )
