"""Exported files read back, each by what reads its format: one that has its final name must be whole."""

from __future__ import annotations

import base64
import gzip
import json
import re
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

#: The page of `degense share`; the other names are those of formats.
SHARED = "html"
SPZ_HEADER, SPZ_BYTES = 16, 20  # of the file, and of a Gaussian: place 9, opacity 1, colour 3, scale 3, rotation 4


@dataclass(frozen=True)
class Expected:
    """What was exported: frames of `shape` of a clip of `count` frames, the first `frames` of them where it is not Gaussians."""

    shape: tuple[int, int]
    count: int
    frames: int


def check_whole(name: str, path: Path, expected: Expected) -> None:
    """AssertionError, or what the reader says, where an export is not whole."""
    if name in ("ply", "ply-sequence"):
        files = sorted(path.glob("*.ply")) if path.is_dir() else [path]
        sound = len(files) == (expected.count if path.is_dir() else 1) and all(map(_ply_is_whole, files))
    elif name == "gltf":
        data = path.read_bytes()
        sound = struct.unpack_from("<I", data, 8)[0] == len(data)
    elif name == "spz":
        data = gzip.decompress(path.read_bytes())
        sound = len(data) == SPZ_HEADER + SPZ_BYTES * struct.unpack_from("<I", data, 8)[0]
    elif name == "movie":
        sound = _pictures(path) == expected.frames
    elif name == SHARED:
        sound = _page_is_whole(path.read_text(encoding="utf-8"))
    else:
        sound = _labels_are_whole(name, path, expected)
    assert sound, f"{path.name} is half written, under its final name"


def _ply_is_whole(path: Path) -> bool:
    data = path.read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    count = int(data[:end].split(b"element vertex ")[1].split()[0])
    return len(data) - end == count * 4 * data[:end].count(b"property float")


def _pictures(path: Path) -> int:
    """How many pictures of a movie can be decoded."""
    import cv2

    movie, count = cv2.VideoCapture(str(path)), 0
    while movie.read()[0]:
        count += 1
    return count


def _page_is_whole(text: str) -> bool:
    """Whether a shared page ends, and holds all numbers that its header speaks of."""
    parts = dict(re.findall(r'<script type="[\w/]+" id="(header|data)">(.*?)</script>', text, re.DOTALL))
    header, data = json.loads(parts["header"]), gzip.decompress(base64.b64decode(parts["data"]))
    numbers = sum(array["width"] * array["times"] * array["size"] for array in header["arrays"])
    return text.rstrip().endswith("</html>") and len(data) == header["gaussians"] * (numbers + 3 * 4)


def _labels_are_whole(name: str, path: Path, expected: Expected) -> bool:
    """Read by the program's own reader, and by those of others where there is one."""
    from degense.engine.annotation.formats import LABEL_FORMATS

    maps = LABEL_FORMATS[name].read(path, expected.shape, [f"{frame:06d}" for frame in range(expected.count)])
    shapes = {maps.read(frame).shape for frame in maps.frames}
    sound = maps.frames == tuple(range(expected.frames)) and shapes == {expected.shape}
    if name == "yolo":  # a text that any reader takes for whole at any end; something is labelled in every frame of what is exported
        sound &= all(text.read_bytes().endswith(b"\n") for text in path.rglob("*.txt"))
    elif name == "coco":
        from pycocotools.coco import COCO

        coco = COCO(path)
        sound &= all(coco.annToMask(one).shape == expected.shape for one in coco.loadAnns(coco.getAnnIds()))
    elif name == "nifti":
        import nibabel

        volume = np.asanyarray(nibabel.nifti1.Nifti1Image.from_filename(path).dataobj)
        sound &= sorted(volume.shape)[-2:] == sorted(expected.shape)
    return sound
