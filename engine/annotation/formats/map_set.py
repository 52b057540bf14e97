"""Label maps that are handed over to a format, or come from one; and what several formats check."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pycocotools.mask as coco_mask

from degense.engine.annotation.edits import LabelClass, check_classes
from degense.engine.annotation.painting import PixelRegion
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import last_number, shown
from degense.engine.errors import ClipError, DegenseError
from degense.engine.untrusted import read_bytes

#: Text files larger than this are refused.
LARGEST_TEXT = 512 << 20
#: Regions of one frame that are drawn: each takes the time of a picture.
MOST_REGIONS = 20_000
#: COCO's compressed counts: numbers of up to seven letters, "P" to "o" but for the last letter, which is one of "0" to "O".
_COMPRESSED = re.compile("([P-o]{0,6}[0-O])+")


@dataclass(frozen=True)
class MapSet:
    """Label maps of some frames of a clip."""

    classes: tuple[LabelClass, ...]
    shape: tuple[int, int]  # (height, width)
    names: tuple[str, ...]  # of all frames of the clip: the stems of their files
    frames: tuple[int, ...]  # those that have a map, ascending
    read: Callable[[int], np.ndarray]  # frame → uint8 [H, W], values index `classes` or are `UNLABELLED`

    def by_class(self) -> MapSet:
        """The same with one value a class: for formats that do not tell the objects of a class apart."""
        names = class_names(self.classes)
        if len(names) == len(self.classes):
            return self
        firsts = tuple(replace(next(kind for kind in self.classes if kind.name.casefold() == name.casefold()), number=1) for name in names)
        table = np.full(256, UNLABELLED, np.uint8)
        table[: len(self.classes)] = [index_of(kind.name, names) for kind in self.classes]
        return replace(self, classes=firsts, read=lambda frame: table[self.read(frame)])


def class_names(classes: Iterable[LabelClass]) -> list[str]:
    """The names of the classes, each once, whatever its case, in the order of their first objects."""
    names: dict[str, str] = {}
    for kind in classes:
        names.setdefault(kind.name.casefold(), kind.name)
    return list(names.values())


def index_of(name: str, names: Sequence[str]) -> int:
    """Where a name stands among names, whatever its case."""
    return [other.casefold() for other in names].index(name.casefold())


def checked_classes(classes: Iterable[LabelClass], path: Path) -> tuple[LabelClass, ...]:
    """The classes that a file names. ClipError when they are too many or two have one name."""
    found = tuple(classes)
    try:
        check_classes(found)
    except DegenseError as error:
        raise ClipError(f"{shown(path)}: {error}") from error
    return found


def drawn(shape: tuple[int, int], regions: Iterable[tuple[PixelRegion | None, int]]) -> np.ndarray:
    """The label map, uint8 [H, W], of regions and their labels, later ones on top. ClipError for more than `MOST_REGIONS`."""
    labels = np.full(shape, UNLABELLED, np.uint8)
    for number, (region, value) in enumerate(regions):
        if number == MOST_REGIONS:
            raise ClipError(f"A frame has more than {MOST_REGIONS:,} regions; draw those of a class as one.")
        if region is not None:
            labels[region.box][region.mask] = value
    return labels


@lru_cache(maxsize=4)
def _frames_by_name(names: tuple[str, ...]) -> tuple[dict[str, int], dict[int | None, int]]:
    """Frames by their stems, and by their numbers where only one has it."""
    numbers = [last_number(Path(own)) for own in names]
    counts = Counter(numbers)
    return {stem: frame for frame, stem in enumerate(names)}, {number: frame for frame, number in enumerate(numbers) if counts[number] == 1}


def frame_of(name: str, names: Sequence[str], source: Path) -> int:
    """The frame that a file name (with or without suffix and folders) means: by its stem, else by its number. ClipError when none."""
    stem = Path(name.replace("\\", "/")).stem
    stems, numbers = _frames_by_name(tuple(names))
    frame = stems.get(stem)
    if frame is None and (number := last_number(Path(stem))) is not None:
        frame = numbers.get(number)
    if frame is not None:
        return frame
    raise ClipError(f"{shown(source)} has labels of {shown(Path(name))}, which is no frame of this clip; its first is {names[0]}.")


def read_text(path: Path) -> str:
    """A UTF-8 text file of bounded size. ClipError otherwise."""
    try:
        return read_bytes(path, LARGEST_TEXT).decode("utf-8")
    except (OSError, ValueError) as error:
        raise ClipError(f"{shown(path)} cannot be read: {error}.") from error


def check_picture_size(found: tuple[int, int], shape: tuple[int, int], path: Path) -> None:
    """ClipError when labels are for pictures of another (width, height)."""
    if found != (shape[1], shape[0]):
        told = f"{found[0]} × {found[1]}"
        raise ClipError(f"{shown(path)} is for pictures of {told} pixels, but the clip's are {shape[1]} × {shape[0]}; scale it first.")


def mask_of_runs(counts: Any, shape: tuple[int, int]) -> np.ndarray:
    """bool [H, W] of run lengths down the columns, zeros first: a list of whole numbers, or a string compressed as COCO does.

    ValueError when they are neither, or do not add up to the pixels.
    """
    pixels = shape[0] * shape[1]
    if isinstance(counts, list) and counts and all(type(count) is int and 0 <= count <= pixels for count in counts):
        counts = coco_mask.frPyObjects({"size": shape, "counts": counts}, *shape)["counts"]
    elif not isinstance(counts, str) or not _COMPRESSED.fullmatch(counts):
        raise ValueError("neither run lengths nor a string of them")
    mask = coco_mask.decode({"size": shape, "counts": counts})  # ValueError for too many pixels
    try:  # too few go unnoticed, but when they fill an array of one pixel less
        coco_mask.decode({"size": (pixels - 1, 1), "counts": counts})
    except ValueError:
        return mask.astype(bool)
    raise ValueError(f"run lengths of fewer than {pixels} pixels")
