"""Label maps as indexed PNG in the colours of the classes: `labels/NAME.png` beside `classes.json`, as clips have them."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from degense.engine.annotation.classes import LabelClass, named_classes
from degense.engine.annotation.formats.map_set import MapSet
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.images import checked, picture_size, read_index
from degense.engine.data.files.labels import index_maps
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError
from degense.engine.files import replacing, write_text


def label_png(labels: np.ndarray, classes: Sequence[LabelClass]) -> bytes:
    """The bytes of a PNG file of a label map, uint8 [H, W]; unlabelled pixels look black."""
    palette = np.zeros((UNLABELLED + 1, 3), np.uint8)
    for index, kind in enumerate(classes):
        palette[index] = kind.colour
    image = Image.fromarray(labels).convert("L")
    image.putpalette(palette.tobytes())
    out = io.BytesIO()
    image.save(out, "PNG", compress_level=1)
    return out.getvalue()


def read_label_png(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """A label map uint8 [H, W] of that shape, from an indexed or grey PNG. ClipError otherwise; the size is checked before decoding."""
    size, found = (shape[1], shape[0]), picture_size(path)
    if found != size:
        raise ClipError(f"{shown(path)} is {found[0]} × {found[1]} pixels, but the frames are {size[0]} × {size[1]}; scale it first.")
    return checked(read_index(path), path, size)


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
