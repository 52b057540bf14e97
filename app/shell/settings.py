"""What the program remembers between starts: a typed JSON file in the user's configuration folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, get_args

import platformdirs

from degense.engine.files import write_text

RECENT_LIMIT = 10
Theme = Literal["dark", "light", "system"]
Background = Literal["dark", "black", "grey", "white"]
BACKGROUNDS: dict[Background, str] = {"dark": "#0f1114", "black": "#000000", "grey": "#808080", "white": "#ffffff"}


def config_folder() -> Path:
    return Path(platformdirs.user_config_dir("degense", appauthor=False))


def log_file() -> Path:
    return Path(platformdirs.user_log_dir("degense", appauthor=False)) / "degense.log"


@dataclass(frozen=True)
class Settings:
    """Preferences and places."""

    theme: Theme = "dark"
    background: Background = "dark"  # of the 3D view, whatever the theme
    recent: tuple[str, ...] = field(default=())  # clips and runs opened last, newest first
    last_folder: str = ""
    open_run: str = ""  # the run that is open now; still there at the next start when the program was not closed
    speed: float = 1.0  # playback speed, 1 = as recorded
    autosave: float = 1.0  # minutes after a change until it is saved; 0 saves only when asked and at the end
    undo_memory: float = 256.0  # megabytes that undo may hold
    #: Keys that the user gave to actions, by action id; actions that are not named have their own.
    shortcuts: dict[str, list[str]] = field(default_factory=dict)
    training: dict[str, Any] = field(default_factory=dict)  # what the training dialog was last started with
    #: Trainings that run, are paused or wait, the first first (`TrainingJob.to_json`); offered again at the next start.
    trainings: tuple[dict[str, Any], ...] = ()
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
    """Settings on disk. Every change is written at once and atomically.

    A file that cannot be read is kept as `settings.json.bad`, the defaults are used, and `complaint` says so once.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or config_folder() / "settings.json"
        self.complaint: str | None = None
        self.value = self._read()

    def update(self, **changes: Any) -> None:
        self.store(replace(self.value, **changes))

    def store(self, settings: Settings) -> None:
        """Make these the settings and write them; nothing is written when nothing changed. DegenseError when the file cannot be written."""
        if settings != self.value:
            self.value = settings
            write_text(self.path, json.dumps(asdict(settings), indent=2))

    def _read(self) -> Settings:
        try:
            return _parse(json.loads(self.path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            return Settings()
        except (OSError, ValueError, TypeError) as error:
            kept = self.path.replace(self.path.with_name(f"{self.path.name}.bad")).name
            self.complaint = f"The settings in {self.path} are unreadable ({error}); they are kept as {kept} and the defaults are used."
            return Settings()


#: What numbers may be.
LIMITS = {"speed": (0.05, 16.0), "autosave": (0.0, 60.0), "undo_memory": (16.0, 8192.0)}


def _texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(entry, str) for entry in value)


#: What other fields than texts and numbers must fulfil, and what that is called.
KINDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "recent": (_texts, "a list of paths"),
    "shortcuts": (lambda value: isinstance(value, dict) and all(map(_texts, value.values())), "lists of keys by action"),
    "training": (lambda value: isinstance(value, dict), "a JSON object"),
    "trainings": (lambda value: isinstance(value, list) and all(isinstance(entry, dict) for entry in value), "a list of JSON objects"),
    "theme": (lambda value: value in get_args(Theme), f"one of {', '.join(get_args(Theme))}"),
    "background": (lambda value: value in BACKGROUNDS, f"one of {', '.join(BACKGROUNDS)}"),
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
