"""The page of an empty window, the demo's tasks, and the tour."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtWidgets import QWidget

from degense.app.features.documents.controller import Documents
from degense.app.features.timeline.controller import TimeControl
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.view_rendering import View
from degense.app.features.welcome import thumbnails
from degense.app.features.welcome.page import WelcomePage
from degense.app.features.welcome.samples import TASKS, Samples
from degense.app.features.welcome.tour import Stop, Tour
from degense.app.session.sample import is_demo
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    documents = shell.service(Documents)
    if documents is None:
        return
    samples = Samples(shell, documents)
    shell.provide(samples)
    show_tour = partial(_show_tour, shell)
    shell.add_actions(Action("help.tour", "Tour", show_tour, ("Help",), (), shell.session.has_scene, help="introduction first steps"))
    samples.arranged.connect(lambda task: None if shell.settings.value.toured else show_tour())
    viewer = shell.service(Viewer)
    _add_page(shell, documents, samples, viewer)
    if viewer is not None:
        _keep_pictures(shell, documents, viewer)


def _add_page(shell: Shell, documents: Documents, samples: Samples, viewer: Viewer | None) -> None:
    """The page stands where the views are, while nothing is open."""
    ways = (
        ("Open a clip", "A folder with frames", documents.ask_for_clip),
        ("Open a video", "A movie file", documents.ask_for_video),
        ("Open a run", "A scene that was reconstructed", documents.ask_for_run),
        ("Demo", "A finished scene, to look around in", documents.open_demo),
    )
    tasks = [(title, words, partial(samples.begin, name)) for name, title, words in TASKS]

    def take_tour() -> None:
        shell.settings.update(toured=False)
        documents.open_demo()

    page = WelcomePage(ways, tasks, take_tour)
    page.chosen.connect(lambda text: documents.open_path(Path(text)))
    shell.docks.add_page(page)
    shell.provide(page)

    def show() -> None:
        if shell.session.frames > 0:
            focused = shell.focusWidget()
            shell.docks.rejoin(page)
            if focused is not None and page.isAncestorOf(focused) and viewer is not None:
                viewer.panel.setFocus()  # else the keyboard goes to what Tab comes to next, a button of the drawer
        elif not page.isVisibleTo(shell):
            page.set_recent(shell.settings.value.recent)
            shell.docks.show_page(page)
            page.ways[0].setFocus()

    shell.session.opened.connect(show)
    shell.started.connect(show)


def _keep_pictures(shell: Shell, documents: Documents, viewer: Viewer) -> None:
    """Keep the first frame that is shown of what was opened."""
    kept = Path()

    def shown(view: View) -> None:
        nonlocal kept
        if documents.path != kept and shell.session.frames > 0:
            kept = documents.path
            if not is_demo(kept):
                thumbnails.keep(kept, view.rgb)

    viewer.shown.connect(shown)


def _show_tour(shell: Shell) -> None:
    """Once by itself, when the demo is opened for the first time; then when it is asked for."""
    shell.settings.update(toured=True)
    if (running := shell.findChild(Tour)) is not None:
        running.end()
    time = shell.service(TimeControl)

    def dock(title: str) -> QWidget | None:
        return next((dock for dock in shell.docks.all if dock.objectName() == title), None)

    stops = (
        Stop(
            "The scene",
            "At the left the reconstruction in 3D, at the right what the camera sees. Click a place in the frame to follow it; drag in 3D "
            "to look from elsewhere, V goes back to the camera.",
            lambda: shell.docks.views,
        ),
        Stop("Time", "Space plays, the arrows step. Drag the dot to any frame.", lambda: time.timeline if time is not None else None),
        Stop("Prompts", "Press / and type what to find, such as liver or grasper. Its mask follows through time.", lambda: dock("Prompts")),
        Stop(
            "Layers",
            "Tick layers to lay them over each other; drag them into another order. The keys 1 to 9 show one alone.",
            lambda: dock("Layers"),
        ),
        Stop(
            "Everything else",
            "Curves, findings, areas and training open here. Ctrl+K finds every action by its name, and F1 opens the guide.",
            lambda: shell.status.stripe,
        ),
    )
    Tour(shell, stops)
