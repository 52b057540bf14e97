"""Files of other tools that are damaged or lie are refused in a sentence."""

from __future__ import annotations

import gzip
import json
import struct
import time
import tracemalloc
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from degense.engine.annotation.edits import named_classes
from degense.engine.annotation.formats import LABEL_FORMATS, MapSet
from degense.engine.annotation.formats.map_set import MOST_REGIONS
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
        ("yolo", yolo("0 0.1 0.1 0.5 0.1 0.5 0.5", "names: {" + '"a": 1,' * 160_000 + "}")),
        ("yolo", yolo("0 0.1 0.1 0.5 0.1 0.5 0.5", "[" * 100_000)),
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


def test_many_entries_of_a_long_clip_are_matched_in_time(tmp_path):
    """20,000 pictures of a clip of 5,000 frames: each was compared with all."""
    names = tuple(f"frame_{index:05d}" for index in range(5000))
    images = [{"id": index, "file_name": f"x_{index % 5000}.png", "width": 64, "height": 48} for index in range(20_000)]
    path = text("a.json", json.dumps({**COCO_ONE, "images": images, "annotations": []}))(tmp_path)
    begin = time.process_time()
    assert len(LABEL_FORMATS["coco"].read(path, SHAPE, names).frames) == 5000
    assert time.process_time() - begin < 10


def test_more_regions_than_anybody_draws_are_refused(tmp_path, maps):
    path = yolo("\n".join(["0 0.1 0.1 0.2 0.1 0.2 0.2"] * (MOST_REGIONS + 1)))(tmp_path)
    with pytest.raises(ClipError, match="more than 20,000 regions"):
        read_all("yolo", path)


def test_a_length_in_a_dicom_file_takes_no_memory(tmp_path, maps):
    """Of its first element with a length of four bytes: the file is read once, whole, and holds no more."""
    path = tmp_path / "a.dcm"
    list(LABEL_FORMATS["dicom-seg"].write(maps, path))
    data = bytearray(path.read_bytes())
    at = data.index(b"OB", 132)
    data[at + 4 : at + 8] = (2**32 - 2).to_bytes(4, "little")
    path.write_bytes(data)
    tracemalloc.start()
    try:
        with pytest.raises(ClipError):
            LABEL_FORMATS["dicom-seg"].read(path, SHAPE, NAMES)
        assert tracemalloc.get_traced_memory()[1] < 256 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("seed", range(30))
def test_a_dicom_file_with_a_byte_changed_is_read_or_refused(tmp_path, maps, seed):
    """Its values are found to be none when they are asked for, in many ways."""
    path = tmp_path / "a.dcm"
    list(LABEL_FORMATS["dicom-seg"].write(maps, path))
    data, rng = bytearray(path.read_bytes()), np.random.default_rng(seed)
    for place in rng.integers(132, 1200, 4):
        data[place] ^= 1 << rng.integers(8)
    path.write_bytes(data)
    with suppress(ClipError):
        read_all("dicom-seg", path)


def test_a_long_list_in_a_data_yaml_takes_seconds(tmp_path):
    path = yolo("0 0 0 1 0 1 1", "names: [fat]\nval:\n" + "- 0\n" * 250_000)(tmp_path)
    begun = time.process_time()
    with suppress(ClipError):
        LABEL_FORMATS["yolo"].read(path, SHAPE, NAMES)
    assert time.process_time() - begun < 6
