"""Indexed PNG: `labels/NAME.png` and `classes.json`, as clips have them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from degense.engine.annotation.classes import named_classes
from degense.engine.annotation.formats.map_set import MapSet
from degense.engine.annotation.label_png import label_png
from degense.engine.data.files.labels import index_maps
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError
from degense.engine.files import replacing, write_text


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write into the folder `out`; yields the frames that are done."""
    for frame in maps.frames:
        with replacing(out / "labels" / f"{maps.names[frame]}.png") as temporary:
            temporary.write_bytes(label_png(maps.read(frame), maps.classes))
        yield frame
    write_text(out / "classes.json", json.dumps({"classes": [kind.name for kind in maps.classes]}))


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The maps of a folder. ClipError when they do not fit the clip."""
    found = index_maps(path, [Path(name) for name in names], (shape[1], shape[0]))
    if found is None:
        raise ClipError(f"{shown(path)} holds no labels/ with PNG files; choose the folder above it.")
    return MapSet(named_classes(found.classes), shape, tuple(names), tuple(sorted(found.files)), found.read)
