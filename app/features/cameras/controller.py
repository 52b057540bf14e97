"""Cameras to come back to, and the flight along them."""

from __future__ import annotations

import time

import numpy as np
from PySide6.QtCore import QObject, QTimer

from degense.app.features.cameras.panel import CameraList
from degense.app.features.cameras.state import CameraBook, CameraPath, Stop, load_path, save_path
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches, frustum
from degense.engine.camera import Camera
from degense.engine.errors import DegenseError
from degense.widgets.splats.guides import Guide

TICK_MS = 30
#: Depth of a camera that is drawn, as a share of the distance to the middle of the scene; its colours; points of a path.
SHOWN_DEPTH, SURGEON, KEPT, PATH_POINTS = 0.2, (90, 200, 250), (250, 160, 60), 100


class Cameras(QObject):
    """Binds the list of cameras to that of the session, and moves the 3D view."""

    def __init__(self, viewer: Viewer, guides: GuideSwitches) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session = viewer, viewer.shell, viewer.session
        session = self.session
        self.book = CameraBook(session.undo)
        self.panel = CameraList(self.book, self.shell.say)
        self.dock = self.shell.add_dock("Cameras", self.panel)
        self.shell.closed.connect(self.land)
        session.register("cameras", self.book)
        self._flight: CameraPath | None = None
        self._started = 0.0
        self._timer = QTimer(self, interval=TICK_MS)
        self._timer.timeout.connect(self._fly_on)
        self.book.changed.connect(lambda record: self._changed())
        self._guides = guides
        self._guides.offer("cameras", "Cameras", self.frustums)
        session.opened.connect(self._opened)
        shown = self.panel
        shown.add_requested.connect(self.add)
        shown.update_requested.connect(self._update)
        shown.chosen.connect(self.go)
        shown.flight_requested.connect(self.fly)

    def can_add(self) -> bool:
        return self.session.scene is not None and self.viewer.splats is not None

    def has_path(self) -> bool:
        return self.session.scene is not None and len(self.book.stops) > 1

    def _opened(self) -> None:
        self.land()
        self.panel.refresh()
        self.shell.refresh()

    def _changed(self) -> None:
        self._guides.refresh()
        self.shell.refresh()

    def frustums(self) -> list[Guide]:
        """The surgeon's camera of this frame, those that were kept, and the path along them, as lines in 3D."""
        scene, stops = self.session.scene, self.book.stops
        assert scene is not None
        assert self.viewer.splats is not None
        surgeon, middle = scene.camera(self.session.frame), self.viewer.splats.camera.pivot()
        depth = SHOWN_DEPTH * float(surgeon.project(middle)[1])
        lines = [frustum(stop.camera, depth, KEPT, stop.name) for stop in stops]
        if self.has_path():
            path = CameraPath(stops)
            eyes = [path.at(seconds)[0].unproject(np.zeros(2), np.array(0.0)) for seconds in np.linspace(0, path.seconds, PATH_POINTS)]
            lines.append(Guide(np.stack(eyes), KEPT))
        free = not self.viewer.splats.camera.is_locked()  # one does not see the camera that one looks through
        return [*lines, frustum(surgeon, depth, SURGEON, "surgeon")] if free else lines

    # Editing

    def _camera(self) -> Camera:
        assert self.viewer.splats is not None
        return self.viewer.splats.camera.current()

    def add(self) -> None:
        """Add the camera of the 3D view, with the frame, behind the chosen row."""
        if self.can_add():
            current = self.panel.current()
            place = self.book.add(self._camera(), float(self.session.frame), current if current >= 0 else None)
            self.panel.refresh(place)
            self.shell.docks.bring(self.dock)

    def _update(self, row: int) -> None:
        if self.can_add():
            self.book.change(row, camera=self._camera(), frame=float(self.session.frame))

    # Going there

    def go(self, row: int) -> None:
        """Show the view of a stop, at its frame."""
        if row < len(self.book.stops):
            self.land()
            stop = self.book.stops[row]
            self._show_from(stop.camera)
            self.session.pause()
            self.session.go_to(round(stop.frame))

    def go_on(self, step: int) -> None:
        """To the next stop, or back, round and round."""
        count = len(self.book.stops)
        if count:
            row = (self.panel.current() + step) % count
            self.panel.refresh(row)
            self.go(row)

    def _show_from(self, camera: Camera) -> None:
        if self.viewer.splats is not None:
            self.viewer.splats.camera.fly_to(camera)
            self.session.camera_mode = "free"

    def fly(self) -> None:
        """Move the 3D view along the path, in real time; again: stop."""
        if self._flight is not None:
            self.land()
        elif self.has_path() and self.viewer.splats is not None:
            self.session.pause()
            self._flight = CameraPath(self.book.stops)
            self._started = time.perf_counter()
            self._timer.start()
            self.panel.set_flying(True)

    def land(self) -> None:
        """Stop the flight where it is."""
        if self._flight is not None:
            self._flight = None
            self._timer.stop()
            self.panel.set_flying(False)

    def _fly_on(self) -> None:
        assert self._flight is not None
        seconds = time.perf_counter() - self._started
        camera, frame = self._flight.at(seconds)
        ended = seconds >= self._flight.seconds
        self._show_from(camera)
        self.session.go_to(round(frame))
        if ended:
            self.land()

    # Files

    def ask_to_save(self) -> None:
        path = self.shell.ask_save("Save camera path", f"{self.session.name}-cameras.json", "Cameras (*.json)")
        if path is not None:
            self.shell.attempt(lambda: save_path(path, self.book.stops))

    def ask_to_open(self) -> None:
        path = self.shell.ask_open("Open camera path", "", "Cameras (*.json)")
        if path is not None:
            self.shell.attempt(lambda: self.book.replace_all(self._fitting(load_path(path))))

    def _fitting(self, stops: tuple[Stop, ...]) -> tuple[Stop, ...]:
        last = self.session.frames - 1
        if any(stop.frame > last for stop in stops):
            raise DegenseError(f"These cameras belong to a longer sequence; this one ends at frame {last}.")
        return stops
