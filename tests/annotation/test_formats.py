"""What is exported is imported again to the pixel, other tools' ways of writing are understood, and nothing hostile is believed."""

from __future__ import annotations

import gzip
import json
import struct
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from degense.engine.annotation.edits import LabelClass, named_classes
from degense.engine.annotation.formats import LABEL_FORMATS, MapSet
from degense.engine.annotation.formats.map_set import mask_of_runs
from degense.engine.annotation.formats.pictures import CHOLECSEG8K, ENDOVIS18
from degense.engine.annotation.formats.yolo import outlines
from degense.engine.annotation.painting import polygon
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError
from tests.annotation.label_maps import COCO_ONE, NAMES, SHAPE, blobs, maps_of, three_classes


@pytest.fixture
def maps() -> MapSet:
    return three_classes()


def exported(name: str, maps: MapSet, folder: Path) -> Path:
    out = folder / f"{name}{LABEL_FORMATS[name].suffix}"
    assert tuple(LABEL_FORMATS[name].write(maps, out))[: len(maps.frames)]
    return out


@pytest.mark.parametrize("name", [name for name in LABEL_FORMATS if name not in ("cholecseg8k", "endovis18")])
def test_round_trip(name, maps, tmp_path):
    again = LABEL_FORMATS[name].read(exported(name, maps, tmp_path), SHAPE, NAMES)
    assert [kind.name for kind in again.classes] == [kind.name for kind in maps.classes]
    assert again.frames == maps.frames
    for frame in maps.frames:
        assert np.array_equal(again.read(frame), maps.read(frame)), f"frame {frame}"


@pytest.mark.parametrize(("name", "table"), [("cholecseg8k", CHOLECSEG8K), ("endovis18", ENDOVIS18)])
def test_round_trip_of_colour_masks(name, table, tmp_path):
    own = maps_of((table.classes[3], table.classes[1], LabelClass(table.classes[4].name.upper().replace(" ", "_"), (1, 2, 3))))
    again = LABEL_FORMATS[name].read(exported(name, own, tmp_path), SHAPE, NAMES)
    order = np.full(256, UNLABELLED, np.uint8)
    order[:3] = 3, 1, 4
    for frame in own.frames:
        assert np.array_equal(again.read(frame), order[own.read(frame)])
    with pytest.raises(DegenseError, match="no class for unicorn"):
        list(table.write(maps_of(named_classes(("unicorn",))), tmp_path / "other"))


def test_cholecseg8k_export_opens_as_a_clip(tmp_path):
    from degense.engine.data.readers import open_clip

    names = tuple(f"frame_{i}_endo" for i in range(3))
    own = MapSet((CHOLECSEG8K.classes[2], CHOLECSEG8K.classes[5]), SHAPE, names, (0, 1, 2), lambda frame: blobs(frame, 2))
    list(CHOLECSEG8K.write(own, tmp_path))
    for name in names:
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((*SHAPE, 3), 90, np.uint8))
    clip = open_clip(tmp_path)
    assert np.array_equal(clip.labels(1) == 5, own.read(1) == 1)


def test_polygons_without_holes_cover_just_the_mask():
    for seed in range(6):
        mask = np.random.default_rng(seed).random((20, 24)) < 0.6
        drawn = np.zeros_like(mask)
        for outline in outlines(mask):
            region = polygon((outline + 0.5).tolist(), mask.shape)
            drawn[region.box] |= region.mask
        assert np.array_equal(drawn, mask)


def test_nifti_is_what_the_standard_says(maps, tmp_path):
    data = gzip.decompress(exported("nifti", maps, tmp_path).read_bytes())
    assert struct.unpack_from("<i", data)[0] == 348
    assert struct.unpack_from("<8h", data, 40)[:4] == (3, 64, 48, 4)
    offset = int(struct.unpack_from("<f", data, 108)[0])
    assert offset % 16 == 0
    volume = np.frombuffer(data[offset:], np.uint8).reshape(4, 48, 64)
    assert np.array_equal(volume[2], maps.read(2) + np.uint8(1))
    assert not volume[1].any()


@pytest.mark.parametrize("kind", ["<i2", ">u2", "<f4"])
def test_nifti_of_other_tools(kind, tmp_path):
    """Another number type and byte order, no comment, a fourth dimension, uncompressed."""
    order = kind[0]
    header = bytearray(352)
    struct.pack_into(f"{order}i", header, 0, 348)
    struct.pack_into(f"{order}8h", header, 40, 4, 64, 48, 1, 4, 1, 1, 1)
    struct.pack_into(f"{order}hh", header, 70, {"i2": 4, "u2": 512, "f4": 16}[kind[1:]], 0)
    struct.pack_into(f"{order}3f", header, 108, 352, 1, 0)
    header[344:348] = b"n+1\0"
    volume = np.random.default_rng(0).integers(0, 3, (4, *SHAPE))
    path = tmp_path / "seg.nii"
    path.write_bytes(bytes(header) + volume.astype(kind).tobytes())
    again = LABEL_FORMATS["nifti"].read(path, SHAPE, NAMES)
    assert [kind.name for kind in again.classes] == ["label 1", "label 2"]
    assert np.array_equal(again.read(2), volume[2].astype(np.uint8) - np.uint8(1))


def test_coco_of_other_tools(tmp_path):
    """Polygons, and run lengths compressed as pycocotools does."""
    mask = np.zeros(SHAPE, bool)
    mask[5:15, 10:20] = True
    square = [20.0, 20.0, 40.0, 20.0, 40.0, 30.0, 20.0, 30.0]
    annotations = [
        {"image_id": 7, "category_id": 9, "segmentation": {"size": [48, 64], "counts": compressed(mask)}},
        {"image_id": 7, "category_id": 3, "segmentation": [square]},
    ]
    path = tmp_path / "a.json"
    path.write_text(json.dumps({**COCO_ONE, "annotations": annotations}))
    again = LABEL_FORMATS["coco"].read(path, SHAPE, NAMES)
    labels = again.read(1)
    assert again.frames == (1,)
    assert np.array_equal(labels == 1, mask)
    assert (labels[21:29, 21:39] == 0).all()


def test_coco_loaders_find_each_connected_part_as_an_instance(maps, tmp_path):
    """What training code does: annotations that are no crowd, each decoded, scored against itself as a detection."""
    coco = COCO(str(exported("coco", maps, tmp_path)))
    assert coco.getAnnIds(iscrowd=True) == []
    for frame in maps.frames:
        drawn, parts = np.full(SHAPE, UNLABELLED, np.uint8), 0
        for item in coco.loadAnns(coco.getAnnIds(imgIds=[frame], iscrowd=False)):
            mask = coco.annToMask(item).astype(bool)
            assert cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[0] == 2
            rows, columns = np.nonzero(mask)
            assert item["bbox"] == [columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1]
            assert item["area"] == mask.sum()
            drawn[mask], parts = item["category_id"] - 1, parts + 1
        assert np.array_equal(drawn, maps.read(frame))
        assert parts > len(maps.classes)
    scores = COCOeval(coco, coco.loadRes([{**item, "score": 1.0} for item in coco.dataset["annotations"]]), "segm")
    scores.params.maxDets = [1, 10, 1000]
    scores.evaluate()
    scores.accumulate()
    assert (scores.eval["recall"][:, :, 0, -1] == 1).all()


def compressed(mask: np.ndarray) -> str:
    """As COCO's maskApi.c writes run lengths."""
    counts = [sum(1 for _ in group) for _, group in groupby(mask.ravel(order="F"))]
    counts, text = ([0, *counts] if mask[0, 0] else counts), ""
    for i, count in enumerate(counts):
        x = count - (counts[i - 2] if i > 2 else 0)
        more = True
        while more:
            code = x & 31
            x >>= 5
            more = x != -1 if code & 16 else x != 0
            text += chr((code | 32 if more else code) + 48)
    return text


@pytest.mark.parametrize("seed", range(5))
def test_run_lengths_mean_what_coco_says(seed):
    mask = np.random.default_rng(seed).random((7, 5)) < seed / 4
    assert np.array_equal(mask_of_runs(compressed(mask), mask.shape), mask)
    flat = mask.ravel(order="F")
    plain = np.diff(np.flatnonzero(np.diff(flat, prepend=False)), prepend=0, append=flat.size).tolist()
    assert np.array_equal(mask_of_runs(plain, mask.shape), mask)


@pytest.mark.parametrize(
    "counts",
    [
        [],
        [34],
        [36],
        [3, 4],
        [35.0],
        [40, -5],
        [True, 34],
        ["35"],
        [2**33, 35],
        None,
        {},
        "",
        "0",
        "T3",
        "oooooooooooo0",
        "o",
        "zz",
        "é",
        "~~~",
    ],
)
def test_run_lengths_that_are_none_are_refused(counts):
    with pytest.raises(ValueError, match=r"run lengths|RLE"):
        mask_of_runs(counts, (7, 5))


def test_cvat_of_other_tools(tmp_path):
    path = tmp_path / "a.xml"
    path.write_text(
        """<?xml version="1.0" encoding="utf-8"?><annotations><version>1.1</version>
        <meta><job><labels><label><name>liver</name><color>#102030</color></label></labels></job></meta>
        <image id="0" name="x/frame_002.png" width="64" height="48">
        <box label="hook" occluded="0" xtl="2.0" ytl="3.0" xbr="12.0" ybr="13.0" z_order="1"></box>
        <polygon label="liver" points="0.00,0.00;30.00,0.00;30.00,20.00;0.00,20.00" z_order="0"></polygon>
        <points label="liver" points="1,1" z_order="0"></points>
        <mask label="hook" rle="1, 2, 1" left="60" top="40" width="2" height="2" z_order="0"></mask></image></annotations>"""
    )
    again = LABEL_FORMATS["cvat"].read(path, SHAPE, NAMES)
    assert again.classes == (LabelClass("liver", (16, 32, 48)), LabelClass("hook", again.classes[1].colour))
    labels = again.read(2)
    assert (labels[4:12, 3:11] == 1).all()
    assert labels[18, 25] == 0
    assert labels[40:42, 60:62].tolist() == [[255, 1], [1, 255]]
