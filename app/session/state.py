"""The parts that every session has: the look, and the place one is at."""

from __future__ import annotations

from typing import Any, Literal, get_args

from degense.app.session.persistent_state import PersistentState
from degense.app.session.targets import Target, target_from_json, target_to_json
from degense.app.session.view_state import ViewState
from degense.engine.errors import RunError

CameraMode = Literal["surgeon", "free"]


class PersistentViewState(PersistentState):
    """The look as part of what is saved."""

    def __init__(self) -> None:
        super().__init__()
        self.view_state = ViewState()

    def clear(self) -> None:
        self.view_state = ViewState()

    def to_json(self) -> Any:
        return self.view_state.to_json()

    def from_json(self, data: Any, source: str) -> None:
        self.view_state = ViewState.from_json(data, source)


class Cursor(PersistentState):
    """Which instant and where from. It is saved, but a change of it is no work that would be missed.

    Attributes
    ----------
    probe : Target or None
        What is followed through time.
    """

    counts = False

    def __init__(self) -> None:
        super().__init__()
        self.clear()

    def clear(self) -> None:
        self.frame = 0
        self.camera_mode: CameraMode = "surgeon"
        self.probe: Target | None = None

    def to_json(self) -> Any:
        return {"frame": self.frame, "camera_mode": self.camera_mode, "probe": target_to_json(self.probe)}

    def from_json(self, data: Any, source: str) -> None:
        try:
            frame, mode, probe = int(data["frame"]), data["camera_mode"], data["probe"]
            if mode not in get_args(CameraMode):
                raise ValueError(f"{mode!r} is no camera mode")
            target = target_from_json(probe)
        except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
            raise RunError(f"{source} does not hold a place in time ({error}).") from error
        self.frame, self.camera_mode, self.probe = max(0, frame), mode, target
