"""The files of a clip: listed in the order of their numbers, and only where they may be read."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from degense.engine import untrusted
from degense.engine.errors import ClipError

MAX_JSON = 64 * 2**20
LONGEST_NAME = 255  # bytes that a name has at most, on every system
LONGEST_STEM = 1000  # letters of a name that are looked at: whole numbers of many thousand digits take minutes
PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


def shown(path: Path) -> str:
    """A path as it may stand in a message: control characters of a hostile name are replaced."""
    return "".join(c if c.isprintable() else "?" for c in str(path))


def natural_key(path: Path) -> tuple:
    """Sorts `frame_9` before `frame_10`."""
    parts = re.split(r"(\d+)", path.stem[:LONGEST_STEM])
    return tuple((1, int(part), "") if part.isdecimal() else (0, 0, part) for part in parts), path.name


def regular_file(path: Path, root: Path) -> Path:
    """`path`, when it is a regular file inside `root`; a pipe would block, and a link may lead to anything. ClipError otherwise."""
    if "\0" in str(path) or len(os.fsencode(path.name)) > LONGEST_NAME:
        raise ClipError(f"{shown(path)} is no name of a file; a file of the clip that names it is damaged.")
    if not path.resolve().is_relative_to(root.resolve()):
        raise ClipError(f"{shown(path)} is a link that leads out of the clip; put the file itself there.")
    if not path.is_file():
        raise ClipError(f"{shown(path)} is not a regular file; remove it or put the file itself there.")
    if not os.access(path, os.R_OK):
        raise ClipError(f"{shown(path)} may not be read; check its permissions.")
    return path


def list_files(folder: Path, root: Path, suffixes: Sequence[str] = PICTURES) -> list[Path]:
    """Regular files of a folder with one of the suffixes, in natural order; empty when there is no such folder.

    Hidden files are no part of a clip.
    ClipError for links out of the clip, for what is no file, and for two files that would be the same frame.
    """
    if not folder.is_dir():
        return []
    if not folder.resolve().is_relative_to(root.resolve()):
        raise ClipError(f"{shown(folder)} is a link that leads out of the clip; put the folder itself there.")
    files = [f for f in folder.iterdir() if f.suffix.lower() in suffixes and not f.name.startswith(".")]
    files = sorted((regular_file(f, root) for f in files), key=natural_key)
    by_stem: dict[str, Path] = {}
    for file in files:
        other = by_stem.setdefault(file.stem, file)
        if other is not file:
            raise ClipError(f"{shown(file)} and {other.name} would be the same frame; remove one of them.")
    return files


def last_number(path: Path) -> int | None:
    """The last whole number in a file's stem; None when it has none."""
    numbers = re.findall(r"\d+", path.stem[-LONGEST_STEM:])
    return int(numbers[-1]) if numbers else None


def pair(frames: Sequence[Path], others: Sequence[Path], what: str) -> None:
    """Check that sorted companion files (masks, depth) belong to the sorted frames one by one.

    Names need not agree, but their numbers must, up to a constant offset: an equal count alone hides two different gaps.
    ClipError otherwise.
    """
    if len(frames) != len(others):
        raise ClipError(f"{shown(others[0].parent)} holds {len(others)} {what}, but there are {len(frames)} frames; each frame needs one.")
    offset = None
    for frame, other in zip(frames, others, strict=True):
        f, o = last_number(frame), last_number(other)
        if f is None or o is None:
            return
        offset = o - f if offset is None else offset
        if o - f != offset:
            raise ClipError(f"{shown(other)} does not belong to {frame.name}: their numbers run apart here, so a file is missing.")


def read_json(path: Path) -> Any:
    """What a JSON file of modest size holds. ClipError otherwise."""
    try:
        return untrusted.read_json(path, MAX_JSON)
    except (OSError, ValueError) as error:
        raise ClipError(f"{shown(path)} is not valid JSON ({error}).") from error
