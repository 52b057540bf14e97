"""Where one is: the frame, the camera and what is probed; and how the clip is played."""

from __future__ import annotations

from typing import Any, Literal, get_args

from degense.app.session.state import PersistentState
from degense.app.session.targets import Target, target_from_json, target_to_json
from degense.engine.errors import RunError, what_is_wrong

CameraMode = Literal["surgeon", "free"]
LoopMode = Literal["once", "loop", "bounce"]


class Cursor(PersistentState):
    """The frame that is shown, the camera mode, and what is probed. Saved, but a change of it is no work that would be missed."""

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
            raise RunError(f"{source} does not hold a frame and camera ({what_is_wrong(error)}).") from error
        self.frame, self.camera_mode, self.probe = max(0, frame), mode, target


class Playback(PersistentState):
    """Which frames are played, and what happens at their end. Saved, but a change of it is no work that would be missed.

    `first` and `last` are the frames that are played first and last; None for those of the sequence.
    """

    counts = False

    def __init__(self) -> None:
        super().__init__()
        self.clear()

    def clear(self) -> None:
        self.first: int | None = None
        self.last: int | None = None
        self.mode: LoopMode = "loop"

    @property
    def whole(self) -> bool:
        """Whether all frames are played."""
        return self.first is None and self.last is None

    def start_at(self, frame: int) -> None:
        """Play from here on; an end that lies before is forgotten."""
        self.first = frame
        if self.last is not None and self.last <= frame:
            self.last = None
        self.changed.emit(None)

    def end_at(self, frame: int) -> None:
        """Play up to here; a start that lies behind is forgotten."""
        self.last = frame
        if self.first is not None and self.first >= frame:
            self.first = None
        self.changed.emit(None)

    def play_all(self) -> None:
        self.first = self.last = None
        self.changed.emit(None)

    def set_mode(self, mode: LoopMode) -> None:
        self.mode = mode
        self.changed.emit(None)

    def to_json(self) -> Any:
        return {"first": self.first, "last": self.last, "mode": self.mode}

    def from_json(self, data: Any, source: str) -> None:
        try:
            first, last = (None if data[name] is None else max(0, int(data[name])) for name in ("first", "last"))
            if data["mode"] not in get_args(LoopMode) or (first is not None and last is not None and last <= first):
                raise ValueError("no way to play")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not say how to play ({what_is_wrong(error)}).") from error
        self.first, self.last, self.mode = first, last, data["mode"]
