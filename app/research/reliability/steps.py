"""Which steps of the program a call takes, so that inputs by which it goes where none went before are damaged further."""

from __future__ import annotations

import os
import sys
from array import array
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import degense.engine

#: Files below are the program's own; libraries are not followed, also where they lie beside it.
OURS = tuple(f"{Path(degense.engine.__file__).parents[1] / part}{os.sep}" for part in ("app", "engine", "widgets"))


def traced(work: Callable[[], object], record: Path) -> None:
    """Do `work`, and write down its steps from one line of the program to the next, also where it raises.

    Threads that it starts, compiled code and imports are not followed.
    """
    steps: set[int] = set()

    def enter(frame: FrameType, event: str, argument: Any) -> Callable[..., Any] | None:
        code = frame.f_code
        if not code.co_filename.startswith(OURS) or code.co_name == "<module>":
            return None
        place, last = hash((code.co_filename, code.co_firstlineno)), 0

        def follow(frame: FrameType, event: str, argument: Any) -> Any:
            nonlocal last
            steps.add(hash((place, last, frame.f_lineno)))
            last = frame.f_lineno
            return follow

        return follow

    sys.settrace(enter)
    try:
        work()
    finally:
        sys.settrace(None)
        record.write_bytes(array("q", steps).tobytes())


def steps_in(record: Path) -> set[int]:
    """What `traced` wrote; none where it was killed before. Numbers of steps are those of one process and its forks."""
    found = array("q")
    if record.exists():
        found.frombytes(record.read_bytes())
    return set(found)
