"""Files of other tools that are damaged or lie are refused in a sentence."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path

import numpy as np
import pytest

from degense.engine.annotation.edits import named_classes
from degense.engine.annotation.formats import LABEL_FORMATS, MapSet
from degense.engine.errors import ClipError
from tests.annotation.label_maps import COCO_ONE, NAMES, SHAPE, maps_of, read_all, three_classes


@pytest.fixture
def maps() -> MapSet:
    return three_classes()


def text(name: str, content: str):
    def write(folder: Path) -> Path:
        path = folder / name
        path.write_text(content)
        return path

    return write


def cvat(body: str):
    image = '<image id="0" name="frame_001.png" width="64" height="48">'
    return text("a.xml", f"<annotations>{image}{body}</image></annotations>")


def coco(**values):
    segmentation = {"size": [48, 64], "counts": [48 * 64]}
    annotations = [{"image_id": 7, "category_id": 3, "segmentation": segmentation, **values.pop("annotation", {})}]
    return text("a.json", json.dumps({**COCO_ONE, "annotations": annotations, **values}))


def yolo(line: str, names: str = "names: [fat]"):
    def write(folder: Path) -> Path:
        (folder / "labels").mkdir()
        (folder / "labels" / "frame_001.txt").write_text(line)
        (folder / "data.yaml").write_text(names)
        return folder

    return write


def nifti(change):
    def write(folder: Path) -> Path:
        path = folder / "a.nii"
        maps = maps_of(named_classes(("fat", "hook")))
        list(LABEL_FORMATS["nifti"].write(maps, path))
        data = bytearray(path.read_bytes())
        path.write_bytes(change(data) or data)
        return path

    return write


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("cvat", text("a.xml", '<!DOCTYPE a [<!ENTITY b "bb">]><annotations>&b;</annotations>')),
        ("cvat", text("a.xml", "<annotations>")),
        ("cvat", text("a.xml", "<annotations/>")),
        ("cvat", cvat('<mask label="a" rle="999999999999" left="0" top="0" width="2" height="2"/>')),
        ("cvat", cvat('<mask label="a" rle="1,3" left="63" top="0" width="2" height="2"/>')),
        ("cvat", cvat('<mask label="a" rle="-1,5" left="0" top="0" width="2" height="2"/>')),
        ("cvat", cvat('<polygon label="a" points="1,2;x,3;4,5"/>')),
        ("cvat", cvat('<polygon label="a" points="1,2;nan,3;4,5"/>')),
        ("cvat", cvat('<box label="" xtl="1" ytl="1" xbr="2" ybr="2"/>')),
        ("coco", text("a.json", "{")),
        ("coco", text("a.json", "[" * 200_000)),
        ("coco", coco(images=[{"id": 7, "file_name": "frame_001.png", "width": 65, "height": 48}])),
        ("coco", coco(images=[{"id": 7, "file_name": "frame_99.png", "width": 64, "height": 48}])),
        ("coco", coco(categories=[])),
        ("coco", coco(annotation={"segmentation": {"size": [48, 64], "counts": [10**30]}})),
        ("coco", coco(annotation={"segmentation": {"size": [48, 64], "counts": [0.5]}})),
        ("coco", coco(annotation={"segmentation": {"size": [1, 1], "counts": [1]}})),
        ("coco", coco(annotation={"segmentation": {"size": [48, 64], "counts": "~~~"}})),
        ("coco", coco(annotation={"segmentation": [["a", "b", "c", "d", "e", "f"]]})),
        ("coco", coco(annotation={"segmentation": {"size": [48, 64], "counts": ""}})),
        ("coco", coco(annotation={"segmentation": {"size": [48, 64], "counts": [3, 4]}})),
        ("coco", coco(annotation={"segmentation": {"size": [2**31, 2**31], "counts": [2**62]}})),
        ("yolo", yolo("0 0.1 0.1 0.2 0.2 7 7")),
        ("yolo", yolo("5 0.1 0.1 0.2 0.2 0.3 0.1")),
        ("yolo", yolo("0 0.1 nan 0.2 0.2 0.3 0.1")),
        ("yolo", yolo("0 0.1 0.1 0.2")),
        ("yolo", yolo("", names="names: 3")),
        ("nifti", nifti(lambda data: data[:-1])),
        ("nifti", nifti(lambda data: data[:100])),
        ("nifti", nifti(lambda data: b"\x1f\x8b" + bytes(90))),
        ("nifti", nifti(lambda data: struct.pack_into("<8h", data, 40, 3, 32767, 32767, 32767, 1, 1, 1, 1))),
        ("nifti", nifti(lambda data: struct.pack_into("<8h", data, 40, 7, 64, 48, 4, 32767, 32767, 32767, 32767))),
        ("nifti", nifti(lambda data: struct.pack_into("<f", data, 108, float("inf")))),
        ("nifti", nifti(lambda data: struct.pack_into("<f", data, 108, float("nan")))),
        ("nifti", nifti(lambda data: struct.pack_into("<f", data, 108, 1e9))),
        ("nifti", nifti(lambda data: struct.pack_into("<i", data, 352, 0))),
        ("nifti", nifti(lambda data: struct.pack_into("<i", data, 352, -(2**31)))),
        ("nifti", nifti(lambda data: struct.pack_into("<i", data, 352, 2**31 - 1))),
        ("nifti", nifti(lambda data: struct.pack_into("<4s", data, 344, b"ni1"))),
        ("nifti", nifti(lambda data: bytes(1000))),
        ("nifti", nifti(lambda data: b"n")),
        ("nifti", nifti(lambda data: struct.pack_into("<h", data, 70, 999))),
        ("nifti", nifti(lambda data: struct.pack_into("<h", data, 70, 128))),
        ("nifti", nifti(lambda data: struct.pack_into("<ff", data, 112, 0.5, 0.3))),
        ("masks-png", lambda folder: folder),
        ("endovis18", lambda folder: folder),
    ],
)
def test_hostile_files_are_refused_in_a_sentence(name, make, tmp_path):
    with pytest.raises(ClipError):
        read_all(name, make(tmp_path))


def test_a_gzip_bomb_is_not_unpacked(tmp_path, maps):
    """What follows the volume is never read."""
    path = tmp_path / "a.nii.gz"
    list(LABEL_FORMATS["nifti"].write(maps, path))
    data = gzip.decompress(path.read_bytes())
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(data)
        for _ in range(64):
            file.write(bytes(1 << 20))
    assert np.array_equal(LABEL_FORMATS["nifti"].read(path, SHAPE, NAMES).read(2), maps.read(2))
