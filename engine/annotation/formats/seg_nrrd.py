"""Segmentations of 3D Slicer (.seg.nrrd): one label volume, x right, y down, z the frame, and a named and coloured segment for each class.

The objects of a class are segments with its name in the tag `DeGense.Class`; the field `DeGense_Frames` lists the labelled frames.
Layers, in which Slicer keeps segments that overlap, are read too: later segments are on top.
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

import numpy as np

from degense.engine.annotation.edits import LabelClass, default_colour
from degense.engine.annotation.formats.map_set import MapSet, check_picture_size, checked_classes
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError
from degense.engine.files import replacing

LARGEST_HEADER = 1 << 20
#: Bytes that compressed data may take beyond what they unpack to.
SPARE = 1 << 20
TYPES = {
    **dict.fromkeys(("uint8", "uint8_t", "uchar", "unsigned char"), "u1"),
    **dict.fromkeys(("int16", "int16_t", "short"), "i2"),
    **dict.fromkeys(("uint16", "uint16_t", "ushort", "unsigned short"), "u2"),
}


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`; yields the frames that are done. Frames without a map are all 0."""
    height, width = maps.shape
    fields = {
        "type": "uint8",
        "dimension": "3",
        "space": "left-posterior-superior",
        "sizes": f"{width} {height} {len(maps.names)}",
        "space directions": "(1,0,0) (0,1,0) (0,0,1)",
        "kinds": "domain domain domain",
        "encoding": "gzip",
        "space origin": "(0,0,0)",
    }
    about = {
        "Segmentation_ContainedRepresentationNames": "Binary labelmap|",
        "Segmentation_SourceRepresentation": "Binary labelmap",
        "Segmentation_ReferenceImageExtentOffset": "0 0 0",
        "DeGense_Frames": " ".join(map(str, maps.frames)),
    }
    for index, kind in enumerate(maps.classes):
        about |= {
            f"Segment{index}_ID": f"Segment_{index + 1}",
            f"Segment{index}_Name": kind.title,
            f"Segment{index}_Color": " ".join(f"{value / 255:.6f}" for value in kind.colour),
            f"Segment{index}_LabelValue": str(index + 1),
            f"Segment{index}_Layer": "0",
            f"Segment{index}_Extent": f"0 {width - 1} 0 {height - 1} 0 {len(maps.names) - 1}",
            f"Segment{index}_Tags": f"DeGense.Class:{kind.name}|DeGense.Number:{kind.number}|",
        }
    lines = ["NRRD0004", *(f"{key}: {text}" for key, text in fields.items())]
    lines += [f"{key}:={text}".replace("\\", "\\\\") for key, text in about.items()]
    blank, labelled = bytes(height * width), set(maps.frames)
    with replacing(out) as temporary, temporary.open("wb") as file:
        file.write("\n".join([*lines, "", ""]).encode())
        with gzip.GzipFile(fileobj=file, mode="wb", compresslevel=6) as packed:
            for frame in range(len(maps.names)):
                packed.write((maps.read(frame) + np.uint8(1)).tobytes() if frame in labelled else blank)
                yield frame


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The segments of a file, one slice a frame. ClipError when it is damaged or does not fit the clip."""
    try:
        with path.open("rb") as file:
            header, start = _header(file.read(LARGEST_HEADER))
            layers = _check(header, shape, len(names), path)
            file.seek(start)
            volume = _volume(file, header, (len(names), *shape, layers))
        segments = _segments(header, layers)
    except (OSError, ValueError, KeyError, zlib.error) as error:
        raise ClipError(f"{shown(path)} is damaged or not a segmentation of 3D Slicer in one file ({error}).") from error
    if not segments:
        raise ClipError(f"{shown(path)} names no segment.")
    classes = checked_classes((kind for kind, _, _ in segments), path)
    frames = [int(text) for text in header.get("DeGense_Frames", "").split() if text.isdigit() and int(text) < len(names)]
    frames = frames or np.flatnonzero(volume.reshape(len(names), -1).any(1)).tolist()

    def labels(frame: int) -> np.ndarray:
        found = np.full(shape, UNLABELLED, np.uint8)
        for index, (_, layer, value) in enumerate(segments):
            found[volume[frame, ..., layer] == value] = index
        return found

    return MapSet(classes, shape, tuple(names), tuple(sorted(set(frames))), labels)


def _header(data: bytes) -> tuple[dict[str, str], int]:
    """The fields of a header, and where the data begin. ValueError for anything else."""
    found = re.search(rb"\r?\n\r?\n", data)
    if not data.startswith(b"NRRD000") or found is None:
        raise ValueError("no such header")
    fields: dict[str, str] = {}
    for line in data[: found.start()].decode("utf-8").splitlines()[1:]:
        key, colon, text = line.partition(":")
        if colon and not line.startswith("#"):
            own = text.startswith("=")
            fields[key.strip()] = re.sub(r"\\(\\|n)", lambda match: match[1].replace("n", " "), text[1:]) if own else text.strip()
    return fields, found.end()


def _check(header: dict[str, str], shape: tuple[int, int], count: int, path: Path) -> int:
    """The number of layers. ClipError or ValueError for a volume that is another than the clip's, or that could not be read safely."""
    if "data file" in header or "datafile" in header:
        raise ClipError(f"{shown(path)} keeps its volume in another file; save it from 3D Slicer as one .seg.nrrd file.")
    sizes = [int(size) for size in header["sizes"].split()]
    layers, *sizes = sizes if len(sizes) == 4 else [1, *sizes]
    if len(sizes) != 3 or not 1 <= layers <= UNLABELLED:
        raise ValueError(f"a volume of {len(sizes)} dimensions")
    check_picture_size((sizes[0], sizes[1]), shape, path)
    if sizes[2] != count:
        raise ClipError(f"{shown(path)} has {sizes[2]} slices, but the clip has {count} frames.")
    if header["type"] not in TYPES or header["encoding"] not in ("raw", "gzip", "gz"):
        raise ValueError(f"{header['type']} values in encoding {header['encoding']}")
    if any(header.get(key, "0") != "0" for key in ("line skip", "lineskip", "byte skip", "byteskip")):
        raise ValueError("a volume that does not follow its header")
    return layers


def _volume(file: IO[bytes], header: dict[str, str], shape: tuple[int, ...]) -> np.ndarray:
    """Whole numbers [T, H, W, layers]. Never more is unpacked than that."""
    kind = np.dtype(TYPES[header["type"]]).newbyteorder(">" if header.get("endian") == "big" else "<")
    size = math.prod(shape) * kind.itemsize
    data = file.read(size + SPARE)
    if header["encoding"] != "raw":
        data = zlib.decompressobj(zlib.MAX_WBITS | 16).decompress(data, size)
    if len(data) < size:
        raise ValueError("it is cut short")
    return np.frombuffer(data[:size], kind).reshape(shape)


def _segments(header: dict[str, str], layers: int) -> list[tuple[LabelClass, int, int]]:
    """Class, layer and value of each segment."""
    found: list[tuple[LabelClass, int, int]] = []
    while f"Segment{len(found)}_ID" in header and len(found) <= UNLABELLED:
        about = {key: header.get(f"Segment{len(found)}_{key}", "") for key in ("Name", "Color", "LabelValue", "Layer", "Tags")}
        tags = dict(part.split(":", 1) for part in about["Tags"].split("|") if ":" in part)
        name, number = tags.get("DeGense.Class", ""), tags.get("DeGense.Number", "1")
        if not number.isdigit() or LabelClass(name, (0, 0, 0), int(number)).title != about["Name"]:
            name, number = about["Name"], "1"  # made or renamed elsewhere
        values = [float(text) for text in about["Color"].split()]
        colour = tuple(round(255 * min(1.0, max(0.0, value))) for value in values) if len(values) == 3 else default_colour(len(found))
        layer, value = int(about["Layer"] or 0), int(about["LabelValue"] or 1)
        if not 0 <= layer < layers:
            raise ValueError(f"a segment in layer {layer} of {layers}")
        found.append((LabelClass(name, (colour[0], colour[1], colour[2]), int(number)), layer, value))
    return found
