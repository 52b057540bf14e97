"""NIfTI-1: one label volume, x right, y down, z the frame; 0 is unlabelled, class k is k + 1.

Names, colours and which frames are labelled stand in a JSON comment of the header, which other tools skip; without it classes are named
by their values.
"""

from __future__ import annotations

import gzip
import io
import json
import math
import warnings
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from degense.engine.annotation.edits import LabelClass, check_classes, named_classes
from degense.engine.annotation.formats.map_set import MapSet, check_picture_size
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError, DegenseError
from degense.engine.files import replacing
from degense.engine.untrusted import parse_json

if TYPE_CHECKING:  # it is imported when a volume is read or written: the window opens without it
    from nibabel.nifti1 import Nifti1Header

LARGEST_COMMENT = 1 << 20


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`, .nii or .nii.gz; yields the frames that are done. Frames without a map are all 0."""
    from nibabel.nifti1 import Nifti1Extension, Nifti1Header

    height, width = maps.shape
    about = {"classes": [{"name": kind.name, "colour": kind.colour, "number": kind.number} for kind in maps.classes], "frames": maps.frames}
    comment = json.dumps(about).encode()
    header = Nifti1Header(extensions=[Nifti1Extension("comment", comment + b" " * (-(len(comment) + 8) % 16))])
    header.set_data_dtype(np.uint8)
    header.set_data_shape((width, height, len(maps.names)))
    header.set_intent("label")
    header.set_slope_inter(1, 0)
    header.set_xyzt_units("unknown", "unknown")
    header.set_sform(np.diag([-1, -1, 1, 1]), "scanner")  # x to the right and y down, as one looks at a picture
    header["descrip"] = "label maps made by DeGense; 0 unlabelled, k + 1 class k"
    blank = bytes(height * width)
    labelled = set(maps.frames)
    with replacing(out) as temporary, _opened(temporary, "wb") as file:
        header.write_to(file)
        for frame in range(len(maps.names)):
            file.write((maps.read(frame) + np.uint8(1)).tobytes() if frame in labelled else blank)
            yield frame


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The volume of a file, one slice a frame. ClipError when it is damaged or does not fit the clip."""
    from nibabel.spatialimages import HeaderDataError

    try:
        with _opened(path, "rb") as file:
            volume, about = _volume(file, path, shape, len(names))
    except (OSError, EOFError, ValueError, KeyError, zlib.error, HeaderDataError) as error:
        raise ClipError(f"{shown(path)} is damaged or not a NIfTI-1 file in one piece, .nii or .nii.gz ({error}).") from error
    classes = _classes(about, int(volume.max(initial=0)), path)
    frames = about.get("frames") if isinstance(about, dict) else None
    if not isinstance(frames, list) or not all(isinstance(i, int) and 0 <= i < len(names) for i in frames):
        frames = [index for index, plane in enumerate(volume) if plane.any()]
    return MapSet(classes, shape, tuple(names), tuple(sorted(set(frames))), lambda frame: volume[frame] - np.uint8(1))


def _opened(path: Path, mode: str) -> IO[bytes]:
    return gzip.open(path, mode, compresslevel=6) if path.name.endswith(".gz") else path.open(mode)  # type: ignore[return-value]


def _volume(file: IO[bytes], path: Path, shape: tuple[int, int], count: int) -> tuple[np.ndarray, Any]:
    """uint8 [T, H, W], 0 unlabelled, and the comment. All sizes are checked against the clip before anything is read."""
    from nibabel.nifti1 import Nifti1Header

    binary = file.read(Nifti1Header.sizeof_hdr)
    if len(binary) < Nifti1Header.sizeof_hdr or binary[344:347] != b"n+1":
        raise ValueError("no such header")
    header = Nifti1Header(binary, check=False)
    sizes = [max(1, int(size)) for size in header.get_data_shape()] + [1, 1]
    check_picture_size((sizes[0], sizes[1]), shape, path)
    if (slices := math.prod(sizes[2:])) != count:
        raise ClipError(f"{shown(path)} has {slices} slices, but the clip has {count} frames.")
    kind = header.get_data_dtype()
    if kind.kind not in "iuf":
        raise ClipError(f"{shown(path)} holds {kind} values; save the labels as 8-bit whole numbers.")
    start = float(header["vox_offset"])
    if not len(binary) + 4 <= start <= len(binary) + 4 + LARGEST_COMMENT:
        raise ClipError(f"{shown(path)} says that its numbers begin at byte {start:g}, which makes no sense.")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of comments whose sizes are no multiples of 16
        whole = Nifti1Header.from_fileobj(io.BytesIO(binary + file.read(int(start) - len(binary))), header.endianness, check=False)
    about = _comment(whole)
    slope, shift = header.get_slope_inter()
    volume = np.empty((count, *shape), np.uint8)
    for plane in volume:
        data = file.read(plane.size * kind.itemsize)
        if len(data) != plane.size * kind.itemsize:
            raise ClipError(f"{shown(path)} is cut short; copy it again.")
        values = np.frombuffer(data, kind).reshape(shape).astype(np.float64)
        if slope is not None:
            values = values * slope + shift
        if not ((values >= 0) & (values <= UNLABELLED) & (values == np.floor(values))).all():
            raise ClipError(f"{shown(path)} holds values that are no labels from 0 to {UNLABELLED}.")
        plane[:] = values
    return volume, about


def _comment(header: Nifti1Header) -> Any:
    """The JSON that `write` left in the header, an empty dict where there is none."""
    for extension in header.extensions:
        if extension.get_code() == 6:
            try:
                return parse_json(extension.content)
            except ValueError:
                return {}  # somebody else's words
    return {}


def _classes(about: Any, largest: int, path: Path) -> tuple[LabelClass, ...]:
    try:
        found = []
        for item in about["classes"]:
            red, green, blue = (int(value) & 255 for value in item["colour"][:3])
            found.append(LabelClass(str(item["name"]), (red, green, blue), int(item.get("number", 1))))
        classes = tuple(found)
        check_classes(classes)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, DegenseError):
        classes = ()
    if len(classes) < largest:  # none, or not all: the values are what is certain
        classes = (*classes, *named_classes(f"label {value}" for value in range(1, largest + 1))[len(classes) :])
    if not classes:
        raise ClipError(f"{shown(path)} holds no label: every value is 0.")
    return classes
