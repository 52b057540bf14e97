"""Cameras to come back to, the flight along them, and movies of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtWidgets import QFileDialog

from degense.app.features.cameras.movie import camera_movie
from degense.app.features.cameras.state import CameraBook, CameraPath, Stop, load_path, save_path
from degense.app.features.viewer.controller import Drawing
from degense.app.session.session import Session
from degense.app.shell.background import write_in_worker
from degense.app.shell.messages import show_error
from degense.app.shell.parts import Parts
from degense.app.shell.worker import RenderService
from degense.engine.camera import Camera
from degense.engine.errors import DegenseError

TICK_MS = 30


class Cameras(QObject):
    """Keeps the list of cameras with the session's, and moves the 3D view.

    Signals
    -------
    changed()
        The stops, or whether one flies along them.
    """

    changed = Signal()

    def __init__(self, session: Session, service: RenderService, parts: Parts, drawing: Drawing) -> None:
        super().__init__(parts)
        self.session, self.service, self.parts, self.drawing = session, service, parts, drawing
        self.book = CameraBook(session.undo)
        session.register("cameras", self.book)
        self._flight: CameraPath | None = None
        self._started = 0.0
        self._timer = QTimer(self)
        self._timer.setInterval(TICK_MS)
        self._timer.timeout.connect(self._fly_on)
        self.book.changed.connect(lambda record: self._list())
        session.opened.connect(self._opened)
        shown = parts.cameras
        shown.add_requested.connect(self.add)
        shown.remove_requested.connect(self.book.remove)
        shown.move_requested.connect(self._move)
        shown.update_requested.connect(self._update)
        shown.chosen.connect(self.go)
        shown.renamed.connect(lambda row, name: self._change(row, name=name))
        shown.timed.connect(lambda row, seconds: self._change(row, seconds=seconds))
        shown.flight_requested.connect(self.fly)
        shown.movie_requested.connect(self.ask_for_movie)

    def can_add(self) -> bool:
        return self.session.scene is not None and self.parts.splats is not None

    def has_path(self) -> bool:
        return self.session.scene is not None and len(self.book.stops) > 1

    def _opened(self) -> None:
        self.land()
        self._list()

    def _list(self, current: int | None = None) -> None:
        self.parts.cameras.set_rows([(stop.name, stop.frame, stop.seconds) for stop in self.book.stops], current)
        self.changed.emit()

    # Editing

    def _camera(self) -> Camera:
        assert self.parts.splats is not None
        return self.parts.splats.camera()

    def add(self) -> None:
        """Keep where the 3D view stands, and the frame, behind the chosen row."""
        if self.can_add():
            current = self.parts.cameras.current()
            place = self.book.add(self._camera(), float(self.session.frame), current if current >= 0 else None)
            self._list(place)
            self.parts.cameras_dock.show()
            self.parts.cameras_dock.raise_()

    def _move(self, row: int, step: int) -> None:
        self._list(self.book.move(row, step))

    def _update(self, row: int) -> None:
        if self.can_add():
            self.book.change(row, camera=self._camera(), frame=float(self.session.frame))

    def _change(self, row: int, **changes: object) -> None:
        try:
            self.book.change(row, **changes)
        except ValueError as error:
            self.parts.say(f"{str(error)[0].upper()}{str(error)[1:]}.")
            self._list()

    # Going there

    def go(self, row: int) -> None:
        """Look from a stop, at its frame."""
        if row < len(self.book.stops):
            self.land()
            stop = self.book.stops[row]
            self._look_from(stop.camera)
            self.session.pause()
            self.session.go_to(round(stop.frame))

    def go_on(self, step: int) -> None:
        """To the next stop, or back, round and round."""
        count = len(self.book.stops)
        if count:
            row = (self.parts.cameras.current() + step) % count
            self._list(row)
            self.go(row)

    def _look_from(self, camera: Camera) -> None:
        if self.parts.splats is not None:
            self.parts.splats.fly_to(camera)
            self.session.camera_mode = "free"

    def fly(self) -> None:
        """Take the path in the 3D view, in real time; again: stop."""
        if self._flight is not None:
            self.land()
        elif self.has_path() and self.parts.splats is not None:
            self.session.pause()
            self._flight = CameraPath(self.book.stops)
            self._started = time.perf_counter()
            self._timer.start()
            self.parts.cameras.set_flying(True)

    def land(self) -> None:
        """End the flight where it is."""
        if self._flight is not None:
            self._flight = None
            self._timer.stop()
            self.parts.cameras.set_flying(False)

    def _fly_on(self) -> None:
        assert self._flight is not None
        seconds = time.perf_counter() - self._started
        camera, frame = self._flight.at(seconds)
        ended = seconds >= self._flight.seconds
        self._look_from(camera)
        self.session.go_to(round(frame))
        if ended:
            self.land()

    # Files

    def ask_for_movie(self) -> None:
        file, _ = QFileDialog.getSaveFileName(self.parts.window, "Movie along the path", f"{self.session.name}-flight.mp4", "Movie (*.mp4)")
        if file:
            self.write_movie(Path(file))

    def write_movie(self, out: Path) -> None:
        """Write a movie of what is shown along the path, in the worker; Export ▸ Stop exporting ends it."""
        scene, stops, view_state = self.session.scene, self.book.stops, self.session.view_state
        assert scene is not None
        words = f"Exporting {out.name}"
        write_in_worker(self.service, self.parts, words, lambda: camera_movie(scene, stops, view_state, out), detailed=True)

    def ask_to_save(self) -> None:
        file, _ = QFileDialog.getSaveFileName(
            self.parts.window, "Save camera path", f"{self.session.name}-cameras.json", "Cameras (*.json)"
        )
        if file:
            self._try(lambda: save_path(Path(file), self.book.stops))

    def ask_to_open(self) -> None:
        file, _ = QFileDialog.getOpenFileName(self.parts.window, "Open camera path", "", "Cameras (*.json)")
        if file:
            self._try(lambda: self.book.replace_all(self._fitting(load_path(Path(file)))))

    def _fitting(self, stops: tuple[Stop, ...]) -> tuple[Stop, ...]:
        last = self.session.frames - 1
        if any(stop.frame > last for stop in stops):
            raise DegenseError(f"These cameras belong to a longer sequence; this one ends at frame {last}.")
        return stops

    def _try(self, act: Callable[[], object]) -> None:
        try:
            act()
        except DegenseError as error:
            show_error(self.parts.window, str(error))
