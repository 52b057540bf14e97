"""What the program remembers between starts: a typed JSON file in the user's configuration folder."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

import platformdirs

from engine.files import write_text

RECENT_LIMIT = 10


def config_folder() -> Path:
    return Path(platformdirs.user_config_dir("degense", appauthor=False))


def log_file() -> Path:
    return Path(platformdirs.user_log_dir("degense", appauthor=False)) / "degense.log"


@dataclass(frozen=True)
class Settings:
    """Preferences and places.

    Attributes
    ----------
    recent : tuple of str
        Clips and runs opened last, newest first.
    speed : float
        Playback speed, 1 = as recorded.
    geometry, state : str
        The window's size and docks, as Qt saves them, base64.
    """

    theme: Literal["dark", "light"] = "dark"
    recent: tuple[str, ...] = field(default=())
    last_folder: str = ""
    speed: float = 1.0
    geometry: str = ""
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
        self._settings = self._read()

    @property
    def value(self) -> Settings:
        return self._settings

    def update(self, **changes: Any) -> None:
        self.store(replace(self._settings, **changes))

    def store(self, settings: Settings) -> None:
        """Make these the settings and write them; nothing is written when nothing changed.

        Raises
        ------
        DegenseError
            When the file cannot be written.
        """
        if settings != self._settings:
            self._settings = settings
            write_text(self.path, json.dumps(asdict(settings), indent=2))

    def _read(self) -> Settings:
        try:
            text = self.path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return Settings()
        except (OSError, UnicodeDecodeError) as error:
            return self._give_up(str(error))
        try:
            return _parse(json.loads(text))
        except (ValueError, TypeError) as error:
            return self._give_up(str(error))

    def _give_up(self, reason: str) -> Settings:
        backup = self.path.with_name(self.path.name + ".bad")
        self.path.replace(backup)
        self.complaint = f"The settings in {self.path} are unreadable ({reason}); they are kept as {backup.name} and the defaults are used."
        return Settings()


def _parse(data: Any) -> Settings:
    """Settings from JSON. Unknown keys (of a newer version) are dropped; a known key of the wrong type is an error."""
    if not isinstance(data, dict):
        raise ValueError("not a JSON object")
    known = {item.name: data[item.name] for item in fields(Settings) if item.name in data}
    defaults = Settings()
    for name, value in known.items():
        wanted = getattr(defaults, name)
        if name == "recent":
            if not isinstance(value, list) or not all(isinstance(entry, str) for entry in value):
                raise ValueError("recent is not a list of paths")
            known[name] = tuple(value[:RECENT_LIMIT])
        elif isinstance(wanted, float):
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.05 <= value <= 16:
                raise ValueError(f"{name} is no number between 0.05 and 16")
            known[name] = float(value)
        elif not isinstance(value, str):
            raise ValueError(f"{name} is not a text")
    if known.get("theme", "dark") not in ("dark", "light"):
        raise ValueError("theme is neither dark nor light")
    return Settings(**known)
