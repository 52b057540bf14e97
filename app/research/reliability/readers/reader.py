"""What reads a file which may come from elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Reader:
    """`make(folder)` writes a sound input there and returns its path; `read(path)` uses it; `spoilt` are patterns of files to damage."""

    name: str
    make: Callable[[Path], Path]
    read: Callable[[Path], object]
    spoilt: tuple[str, ...] = ("**/*",)


def under(make: Callable[[Path], Path]) -> Callable[[Path], Path]:
    """The same in a folder of its own."""
    return lambda folder: make(folder / "input")
