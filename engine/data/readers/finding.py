"""Clips inside a folder, without opening them."""

from __future__ import annotations

import os
from pathlib import Path

from degense.engine.data.readers.cholecseg8k import FRAME
from degense.engine.data.readers.endovis18 import FRAMES
from degense.engine.data.readers.video import SUFFIXES

DEEPEST = 4  # folders down: a data set, a release, a video, a clip
MOST = 10_000


def clips_within(path: Path, deepest: int = DEEPEST) -> list[Path]:
    """Clip folders and videos below a folder, in the order of their names, at most `MOST`; links and hidden folders are left out."""
    found: list[Path] = []
    for child in sorted(path.iterdir()):
        if child.name.startswith(".") or child.is_symlink() or len(found) >= MOST:
            continue
        if child.is_file():
            if child.suffix.lower() in SUFFIXES:
                found.append(child)
        elif child.is_dir() and os.access(child, os.R_OK | os.X_OK):
            if is_clip(child):
                found.append(child)
            elif deepest > 1:
                found += clips_within(child, deepest - 1)
    return found


def is_clip(folder: Path) -> bool:
    """Whether a folder looks like a clip: it has frames in a place of their own, or is named as one of CholecSeg8k."""
    return (folder / "images").is_dir() or (folder / FRAMES).is_dir() or any(FRAME.fullmatch(f.name) for f in folder.iterdir())
