"""Label maps as one picture a frame.

Indexed PNG in the colours of the classes, `labels/NAME.png` beside `classes.json`, as clips have them; and the colour masks of public data
sets, whose colours a published table names.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from degense.engine.annotation.edits import LabelClass, named_classes
from degense.engine.annotation.formats.map_set import MapSet, frame_of
from degense.engine.annotation.label_png import label_png
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.images import check_sizes
from degense.engine.data.files.labels import ColourCodes, ColourMaps, index_maps
from degense.engine.data.files.numbered import list_files, shown
from degense.engine.data.readers import cholecseg8k, endovis18
from degense.engine.errors import ClipError, DegenseError
from degense.engine.files import replacing, write_text


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write into the folder `out`, the objects of a class as one; yields the frames that are done."""
    maps = maps.by_class()
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


@dataclass(frozen=True)
class ColourTable:
    """A data set's classes."""

    title: str
    classes: tuple[LabelClass, ...]  # in the data set's own colours
    ending: str  # what a mask's file name adds to the stem of its frame
    nothing: tuple[int, int, int]  # the colour of unlabelled pixels; of no class
    others: dict[str, str]  # other names, in small letters, that mean a class of the table

    def index(self, name: str) -> int | None:
        """The class that a name means; None when there is none."""
        wanted = _plain(self.others.get(_plain(name), name))
        return next((index for index, kind in enumerate(self.classes) if _plain(kind.name) == wanted), None)

    def write(self, maps: MapSet, out: Path) -> Iterator[int]:
        """Write into the folder `out`; yields the frames done. DegenseError when a class that is used is not in the table."""
        maps = maps.by_class()
        indices = [self.index(kind.name) for kind in maps.classes]
        unknown = [kind.name for kind, index in zip(maps.classes, indices, strict=True) if index is None]
        if unknown:
            known = ", ".join(kind.name for kind in self.classes)
            raise DegenseError(f"{self.title} has no class for {', '.join(unknown)}; rename to one of: {known}.")
        colours = np.tile(np.array(self.nothing, np.uint8), (UNLABELLED + 1, 1))
        for value, index in enumerate(indices):
            assert index is not None
            colours[value] = self.classes[index].colour
        for frame in maps.frames:
            with replacing(out / f"{maps.names[frame]}{self.ending}.png") as temporary:
                Image.fromarray(colours[maps.read(frame)]).save(temporary)
            yield frame

    def read(self, path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
        """The masks of a folder; unknown colours are unlabelled. ClipError when they do not fit the clip."""
        found = [file for file in list_files(path, path, (".png",)) if file.stem.endswith(self.ending)]
        files = {frame_of(file.stem.removesuffix(self.ending), names, file): file for file in found}
        if not files:
            raise ClipError(f"{shown(path)} holds no *{self.ending}.png.")
        size = shape[1], shape[0]
        check_sizes(files.values(), size)
        maps = ColourMaps(files, ColourCodes(kind.colour for kind in self.classes), size)
        return MapSet(self.classes, shape, tuple(names), tuple(sorted(files)), maps.read)


def _plain(name: str) -> str:
    return " ".join(name.casefold().replace("_", " ").replace("-", " ").split())


CHOLECSEG8K = ColourTable(
    "CholecSeg8k",
    tuple(LabelClass(name, colour) for name, _, colour in cholecseg8k.CLASSES),
    "_color_mask",
    (255, 255, 255),
    {
        "background": "Black Background",
        "gi tract": "Gastrointestinal Tract",
        "ligament": "Liver Ligament",
        "hook": "L-hook Electrocautery",
        "l hook": "L-hook Electrocautery",
    },
)
ENDOVIS18 = ColourTable(
    "EndoVis 2018",
    tuple(LabelClass(name, colour) for name, colour in endovis18.CLASSES),
    "",
    (255, 255, 255),
    {"background": "background-tissue"},
)
