"""Cameras: saving them, flying along them."""

from __future__ import annotations

from functools import partial

from degense.app.features.cameras.controller import Cameras
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    viewer, guides = shell.service(Viewer), shell.service(GuideSwitches)
    if viewer is None or guides is None:
        return
    cameras, menu = Cameras(viewer, guides), ("View", "Cameras")
    shell.provide(cameras)

    def any_saved() -> bool:
        return cameras.can_add() and bool(cameras.book.stops)

    shell.add_actions(
        Action("cameras.add", "Keep this camera", cameras.add, menu, ("Ctrl+B",), cameras.can_add, help="bookmark key frame path"),
        Action("cameras.next", "Next camera", partial(cameras.go_on, 1), menu, ("Alt+Down",), any_saved, help="bookmark"),
        Action("cameras.previous", "Previous camera", partial(cameras.go_on, -1), menu, ("Alt+Up",), any_saved, help="bookmark"),
        Action("cameras.fly", "Fly along the cameras", cameras.fly, menu, ("Shift+Space",), cameras.has_path, group=1, help="path preview"),
        Action("cameras.save", "Save the camera path…", cameras.ask_to_save, menu, (), any_saved, group=2, help="json"),
        Action("cameras.open", "Open a camera path…", cameras.ask_to_open, menu, (), cameras.can_add, group=2, help="json"),
    )
