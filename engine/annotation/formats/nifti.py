"""NIfTI-1: one label volume, x right, y down, z the frame; 0 is unlabelled, class k is k + 1.

Names, colours and which frames are labelled stand in a JSON comment of the header, which other tools skip; without it classes are named
by their values.
"""

from __future__ import annotations

import gzip
import json
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from degense.engine.annotation.classes import LabelClass, check_classes, named_classes
from degense.engine.annotation.formats.map_set import MapSet, check_picture_size
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError, DegenseError
from degense.engine.files import replacing

HEADER, COMMENT, LARGEST_COMMENT = 348, 6, 1 << 20
#: NIfTI's codes of the number types that label volumes come in.
TYPES = {2: "u1", 256: "i1", 4: "i2", 512: "u2", 8: "i4", 768: "u4", 16: "f4", 64: "f8"}


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`, .nii or .nii.gz; yields the frames that are done. Frames without a map are all 0."""
    height, width = maps.shape
    about = {"classes": [{"name": kind.name, "colour": kind.colour} for kind in maps.classes], "frames": maps.frames}
    comment = json.dumps(about).encode()
    comment += b" " * (-(len(comment) + 8) % 16)
    offset = HEADER + 4 + 8 + len(comment)
    header = bytearray(HEADER)
    struct.pack_into("<i", header, 0, HEADER)
    struct.pack_into("<8h", header, 40, 3, width, height, len(maps.names), 1, 1, 1, 1)
    struct.pack_into("<hhh", header, 68, 1002, 2, 8)  # intent: labels; uint8, 8 bits
    struct.pack_into("<8f", header, 76, 1, 1, 1, 1, 1, 1, 1, 1)
    struct.pack_into("<3f", header, 108, offset, 1, 0)
    header[148:228] = b"label maps made by DeGense; 0 unlabelled, k + 1 class k".ljust(80, b"\0")
    struct.pack_into("<h", header, 254, 1)  # sform: as scanned
    struct.pack_into("<12f", header, 280, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0)  # x to the right and y down, as one looks at a picture
    header[344:348] = b"n+1\0"
    blank = bytes(height * width)
    labelled = set(maps.frames)
    with replacing(out) as temporary, _opened(temporary, "wb") as file:
        file.write(bytes(header) + b"\1\0\0\0" + struct.pack("<ii", len(comment) + 8, COMMENT) + comment)
        for frame in range(len(maps.names)):
            file.write((maps.read(frame) + np.uint8(1)).tobytes() if frame in labelled else blank)
            yield frame


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The volume of a file, one slice a frame. ClipError when it is damaged or does not fit the clip."""
    try:
        with _opened(path, "rb") as file:
            volume, about = _volume(file, path, shape, len(names))
    except (OSError, EOFError, zlib.error, struct.error) as error:
        raise ClipError(f"{shown(path)} is damaged or not a NIfTI file ({error}).") from error
    classes = _classes(about, int(volume.max(initial=0)), path)
    frames = about.get("frames") if isinstance(about, dict) else None
    if not isinstance(frames, list) or not all(isinstance(i, int) and 0 <= i < len(names) for i in frames):
        frames = [index for index, plane in enumerate(volume) if plane.any()]
    return MapSet(classes, shape, tuple(names), tuple(sorted(set(frames))), lambda frame: volume[frame] - np.uint8(1))


def _opened(path: Path, mode: str) -> IO[bytes]:
    return gzip.open(path, mode, compresslevel=6) if path.name.endswith(".gz") else path.open(mode)  # type: ignore[return-value]


def _volume(file: IO[bytes], path: Path, shape: tuple[int, int], count: int) -> tuple[np.ndarray, Any]:
    """uint8 [T, H, W], 0 unlabelled, and the comment. All sizes are checked against the clip before anything is read."""
    header = file.read(HEADER + 4)
    order = next((order for order in "<>" if len(header) == HEADER + 4 and struct.unpack_from(f"{order}i", header)[0] == HEADER), None)
    if order is None or header[344:347] != b"n+1":
        raise ClipError(f"{shown(path)} is not a NIfTI-1 file in one piece (.nii or .nii.gz).")
    dimensions, *sizes = struct.unpack_from(f"{order}8h", header, 40)
    sizes = [max(1, size) for size in sizes[: max(0, min(dimensions, 7))]] + [1, 1, 1]
    code, _ = struct.unpack_from(f"{order}hh", header, 70)
    offset, slope, shift = struct.unpack_from(f"{order}3f", header, 108)
    check_picture_size((sizes[0], sizes[1]), shape, path)
    if int(np.prod(sizes[2:], dtype=object)) != count:
        raise ClipError(f"{shown(path)} has {int(np.prod(sizes[2:], dtype=object))} slices, but the clip has {count} frames.")
    if code not in TYPES:
        raise ClipError(f"{shown(path)} holds numbers of type {code}; save the labels as 8-bit whole numbers.")
    if not HEADER + 4 <= offset <= HEADER + 4 + LARGEST_COMMENT:
        raise ClipError(f"{shown(path)} says that its numbers begin at byte {offset:g}, which makes no sense.")
    about = _comment(file.read(int(offset) - HEADER - 4), header[HEADER] == 1, order)
    kind = np.dtype(order + TYPES[code])
    volume = np.empty((count, *shape), np.uint8)
    for plane in volume:
        data = file.read(plane.size * kind.itemsize)
        if len(data) != plane.size * kind.itemsize:
            raise ClipError(f"{shown(path)} is cut short; copy it again.")
        values = np.frombuffer(data, kind).reshape(shape).astype(np.float64)
        if slope not in (0.0, 1.0) or (slope and shift):
            values = values * slope + shift
        if not ((values >= 0) & (values <= UNLABELLED) & (values == np.floor(values))).all():
            raise ClipError(f"{shown(path)} holds values that are no labels from 0 to {UNLABELLED}.")
        plane[:] = values
    return volume, about


def _comment(data: bytes, there: bool, order: str) -> Any:
    """The JSON that `write` left, an empty dict where there is none."""
    while there and len(data) >= 8:
        size, code = struct.unpack_from(f"{order}ii", data)
        if size < 16 or size > len(data):
            break
        if code == COMMENT:
            try:
                return json.loads(data[8:size].decode("utf-8"))
            except (ValueError, RecursionError):
                return {}  # somebody else's words
        data = data[size:]
    return {}


def _classes(about: Any, largest: int, path: Path) -> tuple[LabelClass, ...]:
    try:
        listed = [(str(item["name"]), [int(value) & 255 for value in item["colour"]]) for item in about["classes"]]
        classes = tuple(LabelClass(name, (colour[0], colour[1], colour[2])) for name, colour in listed)
        check_classes(classes)
    except (KeyError, TypeError, ValueError, IndexError, DegenseError):
        classes = ()
    if len(classes) < largest:  # none, or not all: the values are what is certain
        classes = (*classes, *named_classes(f"label {value}" for value in range(1, largest + 1))[len(classes) :])
    if not classes:
        raise ClipError(f"{shown(path)} holds no label: every value is 0.")
    return classes
