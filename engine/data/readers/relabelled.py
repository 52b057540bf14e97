"""A clip with other label maps than it came with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from degense.engine.clip import Clip
from degense.engine.data.files.cache import ArrayCache
from degense.engine.data.files.labels import index_maps
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.stored import StoredClip
from degense.engine.errors import ClipError


def frame_names(clip: Clip) -> tuple[str, ...]:
    """What label files of the frames are called: the stems of the pictures, numbers where the frames are no files of their own."""
    if isinstance(clip, StoredClip) and len(clip.pictures.files) == len(clip) > 1:
        return tuple(file.stem for file in clip.pictures.files)
    return tuple(f"{index:06d}" for index in range(len(clip)))


def with_labels(clip: Clip, folder: Path) -> Clip:
    """The clip with the label maps of a folder (`labels/NAME.png` and `classes.json`) instead of its own.

    They are its strokes too: what was only scribbled is for the teacher `strokes` to spread.

    Raises
    ------
    ClipError
        When there are none, or they do not fit the clip.
    """
    if not isinstance(clip, StoredClip):
        raise ClipError(f"Clip '{clip.name}' lies in no files, so it takes no label maps from a folder.")
    maps = index_maps(folder, [Path(name) for name in frame_names(clip)], clip.size)
    if maps is None:
        raise ClipError(f"{shown(folder)} holds no labels/ with PNG files; choose the folder above it.")
    words = f"{len(maps.files)} of {len(clip)} frames, {len(maps.classes)} classes, from {shown(folder)}"
    provenance = {**clip.provenance, "labels": words, "strokes": words}
    return replace(clip, classes=maps.classes, label_maps=maps, stroke_maps=maps, provenance=provenance, cache=ArrayCache())
