"""What lies over the splats of the 3D view: each feature offers lines under a title, and a switch in View ▸ In 3D shows them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.engine.camera import Camera
from degense.widgets.splats.guides import Guide

#: Length of an axis as a share of the distance to the middle of the scene.
AXIS = 0.15


class GuideSwitches:
    """Shows what is switched on, and again whenever a frame is shown or `refresh` is called."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer, self._on = viewer, set[str]()
        self._sources: dict[str, Callable[[], Sequence[Guide]]] = {}
        viewer.shown.connect(lambda view: self.refresh())
        self.offer("axes", "Axes", self._axes)

    def offer(self, name: str, title: str, lines: Callable[[], Sequence[Guide]]) -> None:
        """Let `lines` be switched on and off."""
        self._sources[name] = lines
        has_scene, run = self._viewer.session.has_scene, partial(self.toggle, name)
        action = Action(f"guides.{name}", title, run, ("View", "In 3D"), (), has_scene, lambda: name in self._on, help="3D overlay lines")
        self._viewer.shell.add_actions(action)

    def toggle(self, name: str) -> None:
        self._on ^= {name}
        self.refresh()

    def show(self, name: str) -> None:
        self._on.add(name)
        self.refresh()

    def refresh(self) -> None:
        if self._viewer.splats is not None and self._viewer.session.scene is not None:
            self._viewer.splats.set_guides([line for name, lines in self._sources.items() if name in self._on for line in lines()])

    def _axes(self) -> list[Guide]:
        assert self._viewer.splats is not None
        camera = self._viewer.splats.camera
        middle, scene = camera.pivot(), self._viewer.session.scene
        assert scene is not None
        length = AXIS * float(scene.camera(0).project(middle)[1])
        colours = {"x": (230, 90, 80), "y": (90, 200, 90), "z": (90, 150, 250)}
        return [
            Guide(np.stack([middle, middle + length * way]), colour, name)
            for way, (name, colour) in zip(np.eye(3), colours.items(), strict=True)
        ]


def frustum(camera: Camera, depth: float, colour: tuple[int, int, int], text: str = "") -> Guide:
    """A camera as one line: its four rays up to a depth, and the frame there."""
    w, h = camera.width, camera.height
    corners = camera.unproject(np.array([[0, 0], [w, 0], [w, h], [0, h]], float), np.full(4, depth))
    eye = camera.unproject(np.zeros(2), np.array(0.0))
    a, b, c, d = corners
    return Guide(np.stack([a, b, c, d, a, eye, b, c, eye, d, a, eye]), colour, text)
