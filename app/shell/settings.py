"""What the program remembers between starts: a typed JSON file in the user's configuration folder."""

from __future__ import annotations

import functools
import json
import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

import platformdirs
from filelock import FileLock

from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.untrusted import read_json

log = logging.getLogger(__name__)

RECENT_LIMIT = 10
PATIENCE = 2.0  # seconds to wait for another window that writes
Theme = Literal["dark", "light", "system"]
Background = Literal["dark", "black", "grey", "white"]


def config_folder() -> Path:
    return Path(platformdirs.user_config_dir("degense", appauthor=False))


def log_file() -> Path:
    return Path(platformdirs.user_log_dir("degense", appauthor=False)) / "degense.log"


@dataclass(frozen=True)
class Settings:
    """Preferences and places."""

    theme: Theme = "dark"
    background: Background = "dark"  # of the 3D view, whatever the theme
    text_size: float = 1.0  # times that of the desktop
    recent: tuple[str, ...] = field(default=())  # clips and runs opened last, newest first
    last_folder: str = ""
    speed: float = 1.0  # playback speed, 1 = as recorded
    autosave: float = 1.0  # minutes after a change until it is saved; 0 saves only when asked and at the end
    undo_memory: float = 256.0  # megabytes that undo may hold
    #: Keys that the user gave to actions, by action id; actions that are not named have their own.
    shortcuts: dict[str, list[str]] = field(default_factory=dict)
    training: dict[str, Any] = field(default_factory=dict)  # what the training dialog was last started with
    #: Trainings that run, are paused or wait, the first first (`TrainingJob.to_json`); offered again at the next start.
    trainings: tuple[dict[str, Any], ...] = ()
    trainings_at_once: float = 0.0  # 0: what fits beside the window
    toured: bool = False  # whether the tour was shown, which comes by itself once
    geometry: str = ""  # the window's size and docks, as Qt saves them, base64
    state: str = ""

    def opened(self, path: Path) -> Settings:
        """The settings after `path` was opened: it leads the recent files."""
        entry = str(path.resolve())
        recent = (entry, *(other for other in self.recent if other != entry))[:RECENT_LIMIT]
        return replace(self, recent=recent, last_folder=str(path.resolve().parent))

    def forgotten(self, path: str) -> Settings:
        return replace(self, recent=tuple(other for other in self.recent if other != path))


class SettingsFile:
    """Settings on disk. Every change is written at once and atomically, to what the file holds by then: several windows share it.

    A file that cannot be read is kept as `settings.json.bad`, and `complaint` says so once. Changes that could not be written, which the
    log says, hold in this window and are written with the next one that can be.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or config_folder() / "settings.json"
        self.complaint: str | None = None
        self._unwritten: list[Callable[[Settings], Settings]] = []
        self._held = Settings()
        self.value = self._held = self._read()

    def update(self, **changes: Any) -> None:
        self.change(lambda settings: replace(settings, **changes))

    def change(self, how: Callable[[Settings], Settings]) -> None:
        """Change the settings that the file holds now; nothing is written when nothing changes."""
        self._unwritten.append(how)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(self.path.with_name(f"{self.path.name}.lock"), timeout=PATIENCE, poll_interval=0.01):
                self._held = self._read()
                self.value = self._with_changes()
                if self.value != self._held or not self.path.exists():
                    write_text(self.path, json.dumps(asdict(self.value), indent=2))
                self._held = self.value
                self._unwritten.clear()
        except (OSError, DegenseError) as error:
            log.warning("the settings are not kept: %s", error)
            self.value = self._with_changes()

    def _with_changes(self) -> Settings:
        return functools.reduce(lambda settings, how: how(settings), self._unwritten, self._held)

    def _read(self) -> Settings:
        """What the file holds; what it held last where there is none, or a damaged one."""
        try:
            return _parse(read_json(self.path, 16 << 20))
        except (FileNotFoundError, NotADirectoryError):
            return self._held
        except (OSError, ValueError, TypeError) as error:
            kept = self.path.replace(self.path.with_name(f"{self.path.name}.bad")).name
            self.complaint = f"The settings in {self.path} are unreadable ({error}); they are kept as {kept} and the defaults are used."
            return self._held


#: What numbers may be.
LIMITS = {
    "text_size": (0.8, 2.0),
    "speed": (0.05, 16.0),
    "autosave": (0.0, 60.0),
    "undo_memory": (16.0, 8192.0),
    "trainings_at_once": (0.0, 64.0),
}


def _texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(entry, str) for entry in value)


#: What other fields than texts and numbers must fulfil, and what that is called.
KINDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "recent": (_texts, "a list of paths"),
    "shortcuts": (lambda value: isinstance(value, dict) and all(map(_texts, value.values())), "lists of keys by action"),
    "training": (lambda value: isinstance(value, dict), "a JSON object"),
    "trainings": (lambda value: isinstance(value, list) and all(isinstance(entry, dict) for entry in value), "a list of JSON objects"),
    "toured": (lambda value: isinstance(value, bool), "true or false"),
    "theme": (lambda value: value in get_args(Theme), f"one of {', '.join(get_args(Theme))}"),
    "background": (lambda value: value in get_args(Background), f"one of {', '.join(get_args(Background))}"),
}


def _parse(data: Any) -> Settings:
    """Settings from JSON. Unknown keys (of a newer version) are dropped; a known key of the wrong type is an error."""
    if not isinstance(data, dict):
        raise ValueError("not a JSON object")
    return Settings(**{item.name: _checked(item.name, data[item.name]) for item in fields(Settings) if item.name in data})


def _checked(name: str, value: Any) -> Any:
    if name in LIMITS:
        low, high = LIMITS[name]
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise ValueError(f"{name} is no number between {low:g} and {high:g}")
        return float(value)
    fits, kind = KINDS.get(name, (lambda value: isinstance(value, str), "a text"))
    if not fits(value):
        raise ValueError(f"{name} is not {kind}")
    return tuple(value[:RECENT_LIMIT]) if name == "recent" else tuple(value) if name == "trainings" else value
