"""Cameras worth coming back to. In their order they are the stops of a path that a camera can take through space and time."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from degense.app.session.camera_json import camera_from_json, camera_to_json
from degense.app.session.state import PersistentState
from degense.app.session.undo import UndoStack
from degense.engine.camera import Camera
from degense.engine.errors import DegenseError, RunError, what_is_wrong
from degense.engine.files import write_text
from degense.engine.untrusted import read_json

MOST_STOPS, LONGEST_SECONDS = 1000, 3600.0
LARGEST_FILE = 4 << 20


@dataclass(frozen=True)
class Stop:
    """A camera at an instant."""

    name: str
    camera: Camera
    frame: float
    seconds: float = 2.0  # how long the way to the next stop takes, positive


class CameraPath:
    """The smooth way through two or more stops.

    The eye runs on a natural cubic spline, the rotation on a spline of rotations with continuous angular acceleration; focal length and
    frame run monotonely from stop to stop, so that they never overshoot. DegenseError for fewer stops.
    """

    def __init__(self, stops: tuple[Stop, ...]) -> None:
        if len(stops) < 2:
            raise DegenseError("A path needs two cameras at least; add another one.")
        from scipy.interpolate import CubicSpline, PchipInterpolator
        from scipy.spatial.transform import Rotation, RotationSpline

        self.stops = stops
        self._times = np.concatenate([[0.0], np.cumsum([stop.seconds for stop in stops[:-1]])])
        turns = np.stack([stop.camera.viewmat[:3, :3] for stop in stops])
        eyes = np.stack([-stop.camera.viewmat[:3, :3].T @ stop.camera.viewmat[:3, 3] for stop in stops])
        lenses = [stop.camera for stop in stops]
        inner = np.array([[np.log(c.fx / c.width), np.log(c.fy / c.width), c.cx / c.width, c.cy / c.height] for c in lenses])
        self._turn = RotationSpline(self._times, Rotation.from_matrix(turns))
        self._eye = CubicSpline(self._times, eyes, bc_type="natural")
        self._inner = PchipInterpolator(self._times, inner)
        self._frame = PchipInterpolator(self._times, np.array([stop.frame for stop in stops]))

    @property
    def seconds(self) -> float:
        return float(self._times[-1])

    def at(self, seconds: float) -> tuple[Camera, float]:
        """Camera and (fractional) frame at a time since the first stop, clamped to the path. The size is that of the first stop."""
        seconds = float(np.clip(seconds, 0.0, self.seconds))
        first = self.stops[0].camera
        log_fx, log_fy, cx, cy = self._inner(seconds)
        viewmat = np.eye(4)
        viewmat[:3, :3] = self._turn(seconds).as_matrix()
        viewmat[:3, 3] = -viewmat[:3, :3] @ self._eye(seconds)
        focal = np.exp([log_fx, log_fy]) * first.width
        camera = Camera(first.width, first.height, float(focal[0]), float(focal[1]), cx * first.width, cy * first.height, viewmat)
        return camera, float(self._frame(seconds))


class CameraBook(PersistentState):
    """The stops of a session, edited through its undo stack."""

    def __init__(self, undo: UndoStack) -> None:
        super().__init__()
        self.undo = undo
        self._stops: tuple[Stop, ...] = ()

    @property
    def stops(self) -> tuple[Stop, ...]:
        return self._stops

    def add(self, camera: Camera, frame: float, after: int | None = None) -> int:
        """Add a stop behind the one at `after` (None: at the end); its place."""
        place = len(self._stops) if after is None else after + 1
        names = {stop.name for stop in self._stops}
        name = next(name for k in range(1, len(names) + 2) if (name := f"Camera {k}") not in names)
        self._edit(f"Add {name}", (*self._stops[:place], Stop(name, camera, frame), *self._stops[place:]))
        return place

    def remove(self, place: int) -> None:
        self._edit(f"Remove {self._stops[place].name}", self._stops[:place] + self._stops[place + 1 :])

    def move(self, place: int, step: int) -> int:
        """Exchange a stop with one before or behind it; its new place."""
        other = min(max(place + step, 0), len(self._stops) - 1)
        stops = list(self._stops)
        stops[place], stops[other] = stops[other], stops[place]
        self._edit(f"Move {self._stops[place].name}", tuple(stops))
        return other

    def change(self, place: int, **changes: Any) -> None:
        """Give a stop another name, camera, frame or duration. ValueError for an empty name or a duration out of range."""
        stop = replace(self._stops[place], **changes)
        if not stop.name.strip() or not 0 < stop.seconds <= LONGEST_SECONDS:
            raise ValueError(f"a stop has a name and a duration of up to {LONGEST_SECONDS:g} s")
        self._edit(f"Change {stop.name}", (*self._stops[:place], stop, *self._stops[place + 1 :]))

    def replace_all(self, stops: tuple[Stop, ...]) -> None:
        """Take other stops, as read from a file."""
        self._edit("Open a camera path", stops)

    def _edit(self, name: str, stops: tuple[Stop, ...]) -> None:
        self.undo.do(name, self._restore, self._stops, stops)

    def _restore(self, stops: tuple[Stop, ...]) -> None:
        self._stops = stops
        self.changed.emit(None)

    def clear(self) -> None:
        self._stops = ()

    def to_json(self) -> Any:
        return [_stop_json(stop) for stop in self._stops]

    def from_json(self, data: Any, source: str) -> None:
        try:
            self._stops = _stops(data)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not hold cameras ({what_is_wrong(error)}).") from error


def save_path(path: Path, stops: tuple[Stop, ...]) -> None:
    """Write stops as JSON, atomically."""
    write_text(path, json.dumps({"cameras": [_stop_json(stop) for stop in stops]}, indent=2))


def load_path(path: Path) -> tuple[Stop, ...]:
    """The stops that `save_path` wrote. DegenseError when the file cannot be read or holds no cameras."""
    try:
        return _stops(read_json(path, LARGEST_FILE)["cameras"])
    except (OSError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise DegenseError(
            f"{path} does not hold a camera path ({what_is_wrong(error)}); choose a file that was saved from the list of cameras."
        ) from error


def _stop_json(stop: Stop) -> dict[str, Any]:
    return {"name": stop.name, "frame": stop.frame, "seconds": stop.seconds, "camera": camera_to_json(stop.camera)}


def _stops(data: Any) -> tuple[Stop, ...]:
    if not isinstance(data, list) or len(data) > MOST_STOPS:
        raise ValueError(f"not a list of up to {MOST_STOPS} cameras")
    stops = []
    for item in data:
        frame, seconds = float(item["frame"]), float(item["seconds"])
        if not (np.isfinite(frame) and frame >= 0 and 0 < seconds <= LONGEST_SECONDS):
            raise ValueError("a camera at no time")
        stops.append(Stop(str(item["name"])[:200] or "Camera", camera_from_json(item["camera"]), frame, seconds))
    return tuple(stops)
