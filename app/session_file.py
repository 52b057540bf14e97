"""The file in a run folder that holds what the window showed and what was done in it: named parts as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from engine.errors import RunError
from engine.files import write_text

NAME = "session.json"
#: The name of the look among the parts.
LOOK = "look"
LARGEST = 64 << 20


def read(path: Path) -> dict[str, Any]:
    """The parts by name; empty when there is no file.

    Raises
    ------
    RunError
        When the file cannot be read or is no session file.
    """
    try:
        if path.stat().st_size > LARGEST:
            raise ValueError(f"more than {LARGEST >> 20} MiB")
        data = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        raise RunError(f"{path} cannot be read ({error}); delete it to start with a fresh view.") from error
    match data:
        case {"parts": dict(parts)}:
            return parts
        case {"layer": _}:  # as written before there were parts: the look alone
            return {LOOK: data}
    raise RunError(f"{path} does not hold a saved session; delete it to start with a fresh view.")


def write(path: Path, parts: dict[str, Any]) -> None:
    """Replace the file; the old one stays when the new one cannot be written whole.

    Raises
    ------
    DegenseError
        When the folder cannot be written.
    """
    write_text(path, json.dumps({"parts": parts}, indent=2))
