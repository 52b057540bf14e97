"""Objects of one class, and the formats of 3D Slicer, DICOM, Label Studio and CVAT for video, read with libraries that are not ours."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import cv2
import highdicom
import nrrd
import numpy as np
import pytest

from degense.engine.annotation.edits import LabelClass, merged
from degense.engine.annotation.formats import LABEL_FORMATS, MapSet
from degense.engine.annotation.formats.label_studio import decode, encode
from degense.engine.clip import UNLABELLED
from degense.engine.errors import ClipError, DegenseError
from tests.annotation.label_maps import NAMES, SHAPE, maps_of, read_all, three_classes

GRASPERS = (LabelClass("Grasper", (200, 10, 20)), LabelClass("liver", (5, 120, 80)), LabelClass("Grasper", (30, 40, 250), 2))
#: Formats that tell the objects of a class apart; the others hold one label a class.
OF_OBJECTS = ("coco", "cvat", "cvat-video", "label-studio", "nifti", "seg-nrrd", "dicom-seg")


def exported(name: str, maps: MapSet, folder: Path) -> Path:
    out = folder / f"{name}{LABEL_FORMATS[name].suffix}"
    assert len(list(LABEL_FORMATS[name].write(maps, out))) >= len(maps.frames)
    return out


@pytest.mark.parametrize("name", [name for name in LABEL_FORMATS if name not in ("cholecseg8k", "endovis18")])
def test_two_graspers_are_two_objects_of_one_class(name, tmp_path):
    maps = maps_of(GRASPERS)
    again = LABEL_FORMATS[name].read(exported(name, maps, tmp_path), SHAPE, NAMES)
    wanted = maps if name in OF_OBJECTS else maps.by_class()
    assert {kind.title for kind in again.classes} == {kind.title for kind in wanted.classes}
    classes, table = merged(wanted.classes, again.classes)
    assert len(classes) == len(wanted.classes)
    for frame in maps.frames:
        assert np.array_equal(table[again.read(frame)], wanted.read(frame))


def test_one_label_a_class_merges_objects():
    maps = maps_of(GRASPERS).by_class()
    assert [kind.name for kind in maps.classes] == ["Grasper", "liver"]
    assert np.array_equal(maps.read(0), np.array([0, 1, 0, *[255] * 253], np.uint8)[maps_of(GRASPERS).read(0)])


def test_slicer_segments_with_pynrrd(tmp_path):
    maps = three_classes()
    volume, header = nrrd.read(str(exported("seg-nrrd", maps, tmp_path)), index_order="C")
    assert header["space"] == "left-posterior-superior"
    assert header["Segment0_Name"] == "Grasper"
    assert np.allclose(np.array(header["Segment1_Color"].split(), float) * 255, maps.classes[1].colour, atol=0.01)
    for frame in maps.frames:
        assert np.array_equal(volume[frame], maps.read(frame) + np.uint8(1))
    assert not volume[1].any()


def test_slicer_segments_in_layers_written_by_pynrrd(tmp_path):
    """Segments that overlap lie in layers, with values of their own, as 16-bit numbers."""
    layers = np.zeros((4, *SHAPE, 2), np.int16)
    layers[2, 5:20, 5:20, 0] = 7
    layers[2, 10:30, 10:30, 1] = 7
    about = {"Segment0_ID": "a", "Segment0_Name": "liver", "Segment0_Color": "1 0.5 0", "Segment0_LabelValue": "7", "Segment0_Layer": "0"}
    about |= {"Segment1_ID": "b", "Segment1_Name": "hook", "Segment1_LabelValue": "7", "Segment1_Layer": "1"}
    path = tmp_path / "a.seg.nrrd"
    nrrd.write(str(path), layers, {"encoding": "raw", **about}, index_order="C")
    again = LABEL_FORMATS["seg-nrrd"].read(path, SHAPE, NAMES)
    assert again.frames == (2,)
    assert again.classes[0] == LabelClass("liver", (255, 128, 0))
    labels = again.read(2)
    assert (labels[5:10, 5:20] == 0).all()
    assert (labels[10:30, 10:30] == 1).all()
    assert (labels == UNLABELLED).sum() == labels.size - 15 * 15 - 20 * 20 + 10 * 10


def test_dicom_segments_with_highdicom(tmp_path):
    maps = maps_of(GRASPERS)
    seg = highdicom.seg.segread(exported("dicom-seg", maps, tmp_path))
    assert [seg.get_segment_description(number).SegmentLabel for number in (1, 2, 3)] == ["Grasper", "liver", "Grasper 2"]
    types = [seg.get_segment_description(number).segmented_property_type for number in (1, 2, 3)]
    assert types[0] == types[2] != types[1]
    volume = seg.get_volume(combine_segments=True, rtol=1e-3, allow_missing_positions=True)
    assert volume.array.shape == (4, *SHAPE)
    for frame in maps.frames:
        [[plane, *_]] = np.round(volume.map_reference_to_indices(np.array([[0.0, 0.0, frame]]))).astype(int)
        assert np.array_equal(volume.array[plane], maps.read(frame) + np.uint8(1))
    again = LABEL_FORMATS["dicom-seg"].read(tmp_path / "dicom-seg.dcm", SHAPE, NAMES)
    assert np.abs(np.subtract([kind.colour for kind in again.classes], [kind.colour for kind in GRASPERS])).max() <= 1


@pytest.mark.parametrize("frames", [(0,), (0, 2)])
def test_a_dicom_segmentation_of_one_class_is_read(frames, tmp_path):
    """What is the same for all masks then stands once, beside them."""
    label_map = np.full(SHAPE, UNLABELLED, np.uint8)
    label_map[3:9, 4:20] = 0
    maps = MapSet(GRASPERS[1:2], SHAPE, NAMES, frames, lambda frame: label_map)
    again = LABEL_FORMATS["dicom-seg"].read(exported("dicom-seg", maps, tmp_path), SHAPE, NAMES)
    assert tuple(again.frames) == frames
    assert all(np.array_equal(again.read(frame), label_map) for frame in frames)


def test_an_empty_dicom_segmentation_is_not_written(tmp_path):
    maps = MapSet(GRASPERS, SHAPE, NAMES, (0,), lambda frame: np.full(SHAPE, UNLABELLED, np.uint8))
    with pytest.raises(DegenseError, match="No pixel"):
        list(LABEL_FORMATS["dicom-seg"].write(maps, tmp_path / "a.dcm"))
    assert not list(tmp_path.iterdir())


#: What `mask2rle` of label-studio-sdk 2.1.2 makes of a mask of 6 × 5 pixels: rows 1 to 3 from column 2 on, but for one pixel.
BY_LABEL_STUDIO = [0, 0, 0, 120, 57, 27, 254, 27, 0, 183, 255, 56, 5, 191, 249, 192, 35, 255, 140, 2, 63, 252, 78, 0]


def test_brush_masks_are_those_of_label_studio():
    mask = np.zeros((6, 5), bool)
    mask[1:4, 2:] = True
    mask[3, 3] = False
    assert encode(mask) == BY_LABEL_STUDIO
    assert np.array_equal(decode(BY_LABEL_STUDIO, (6, 5)), mask)


@pytest.mark.parametrize("seed", range(4))
def test_brush_masks_are_read_again(seed):
    mask = np.random.default_rng(seed).random((23, 31)) < seed / 3
    assert np.array_equal(decode(encode(mask), mask.shape), mask)


def test_label_studio_export_with_polygons_and_boxes(tmp_path):
    about = {"from_name": "label", "to_name": "image", "original_width": 64, "original_height": 48}
    polygon = {"points": [[0, 0], [50, 0], [50, 50], [0, 50]], "closed": True, "polygonlabels": ["liver"]}
    box = {"x": 50, "y": 50, "width": 25, "height": 25, "rotation": 0, "rectanglelabels": ["hook"]}
    result = [{**about, "type": "polygonlabels", "value": polygon}, {**about, "type": "rectanglelabels", "value": box}]
    task = {"data": {"image": "s3://bucket/clip/frame_002.png"}, "annotations": [{"was_cancelled": True}, {"result": result}]}
    path = tmp_path / "a.json"
    path.write_text(json.dumps([task]))
    again = LABEL_FORMATS["label-studio"].read(path, SHAPE, NAMES)
    labels = again.read(2)
    assert [kind.name for kind in again.classes] == ["liver", "hook"]
    assert (labels[1:23, 1:31] == 0).all()
    assert (labels[25:35, 33:47] == 1).all()
    assert (labels[:, 50:] == UNLABELLED).all()


def test_cvat_tracks_are_polygons_that_leave_the_picture(tmp_path):
    """What CVAT reads: polygons at every key frame, none before the object is seen, and outside where it is not."""
    maps = maps_of(GRASPERS)
    root = ElementTree.parse(exported("cvat-video", maps, tmp_path)).getroot()
    assert root.findtext("meta/task/original_size/width") == "64"
    assert [label.findtext("name") for label in root.iter("label")] == ["Grasper", "liver"]
    drawn = np.zeros(SHAPE, np.uint8)
    for track in root.findall("track"):
        assert track.get("label") in ("Grasper", "liver")
        shapes = track.findall("polygon")
        seen = {int(item.get("frame", "")): item.get("outside") == "0" for item in shapes}
        assert list(seen) == sorted(seen)
        assert seen[min(seen)]
        assert seen.get(1, False) is False  # frame 1 is not labelled
        assert 0 not in seen or 1 in seen
        for item in shapes:
            if item.get("frame") == "2" and item.get("outside") == "0" and track.get("label") == "liver":
                corners = [[round(float(side) - 0.5) for side in corner.split(",")] for corner in item.get("points", "").split(";")]
                cv2.fillPoly(drawn, [np.array(corners)], 1)
    assert np.array_equal(drawn == 1, maps.read(2) == 1)


def test_cvat_tracks_that_never_meet_are_one_object(tmp_path):
    def track(label: str, *frames: int) -> str:
        box = '<box frame="{}" keyframe="1" outside="0" occluded="0" xtl="{}" ytl="2" xbr="{}" ybr="9" z_order="0"/>'
        x = {"hook": 3, "clip": 30}[label]
        return f'<track id="0" label="{label}">{"".join(box.format(frame, x, x + 8) for frame in frames)}</track>'

    path = tmp_path / "a.xml"
    path.write_text(f"<annotations>{track('hook', 0)}{track('hook', 1)}{track('clip', 0, 1)}{track('hook', 1, 2)}</annotations>")
    again = LABEL_FORMATS["cvat-video"].read(path, SHAPE, NAMES)
    assert sorted(kind.title for kind in again.classes) == ["clip", "hook", "hook 2"]
    assert again.frames == (0, 1, 2)


def text(content: str):
    return lambda path: path.write_text(content)


def slicer(**fields: str):
    own = {"type": "uint8", "dimension": "3", "sizes": "64 48 4", "encoding": "raw", **fields}
    head = "\n".join(["NRRD0004", *(f"{key.replace('_', ' ')}: {value}" for key, value in own.items()), "Segment0_ID:=a", "", ""])
    return lambda path: path.write_bytes(head.encode() + bytes(64 * 48 * 4))


def studio(**value):
    item = {"type": "brushlabels", "original_width": 64, "original_height": 48, "value": {"brushlabels": ["a"], **value}}
    return text(json.dumps([{"data": {"image": "frame_001.png"}, "annotations": [{"result": [item]}]}]))


def dicom(change):
    def write(path: Path) -> None:
        import pydicom

        list(LABEL_FORMATS["dicom-seg"].write(three_classes(), path))
        data = pydicom.dcmread(path)
        change(data)
        data.save_as(path)

    return write


def far_away(data) -> None:
    data.PerFrameFunctionalGroupsSequence[0].PlanePositionSequence[0].ImagePositionPatient = [0, 0, 99]


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("seg-nrrd", text("")),
        ("seg-nrrd", text("NRRD0004\ntype: uint8")),
        ("seg-nrrd", slicer(sizes="64 48 5")),
        ("seg-nrrd", slicer(sizes="64 48 99999999999999")),
        ("seg-nrrd", slicer(sizes="-64 -48 4")),
        ("seg-nrrd", slicer(sizes="999999999 64 48 4")),
        ("seg-nrrd", slicer(type="double")),
        ("seg-nrrd", slicer(encoding="bzip2")),
        ("seg-nrrd", slicer(encoding="gzip")),
        ("seg-nrrd", slicer(data_file="/etc/passwd")),
        ("seg-nrrd", slicer(byte_skip="-1")),
        ("seg-nrrd", slicer()),
        ("label-studio", text("{")),
        ("label-studio", text("[" * 100_000)),
        ("label-studio", text("[1]")),
        ("label-studio", studio(rle=[0, 0])),
        ("label-studio", studio(rle=[255] * 40)),
        ("label-studio", studio(rle=[0.5] * 40)),
        ("label-studio", studio(rle="abc")),
        ("label-studio", studio(rle=encode(np.zeros((49, 64), bool)))),
        ("label-studio", studio(rle=encode(np.zeros(SHAPE, bool))[:-2])),
        ("cvat-video", text('<!DOCTYPE a [<!ENTITY b "bb">]><annotations>&b;</annotations>')),
        ("cvat-video", text("<annotations/>")),
        ("cvat-video", text('<annotations><track label="a"><box frame="9" outside="0"/></track></annotations>')),
        ("cvat-video", text('<annotations><track label="a"><polygon frame="1" points="1,2;nan,3;4,5"/></track></annotations>')),
        ("dicom-seg", text("")),
        ("dicom-seg", lambda path: path.write_bytes(bytes(128) + b"DICM" + bytes(999))),
        ("dicom-seg", dicom(lambda data: setattr(data, "Rows", 49))),
        ("dicom-seg", dicom(lambda data: setattr(data, "NumberOfFrames", 10**6))),
        ("dicom-seg", dicom(lambda data: setattr(data, "PixelData", b"\0\0"))),
        ("dicom-seg", dicom(lambda data: setattr(data, "SegmentationType", "FRACTIONAL"))),
        ("dicom-seg", dicom(lambda data: data.__delitem__("SegmentSequence"))),
        ("dicom-seg", dicom(far_away)),
    ],
)
def test_hostile_files_are_refused_in_a_sentence(name, make, tmp_path):
    path = tmp_path / f"a{LABEL_FORMATS[name].suffix}"
    make(path)
    with pytest.raises(ClipError):
        read_all(name, path)


def test_a_gzip_bomb_in_a_slicer_file_is_not_unpacked(tmp_path):
    import gzip

    path = tmp_path / "a.seg.nrrd"
    list(LABEL_FORMATS["seg-nrrd"].write(three_classes(), path))
    data = path.read_bytes()
    start = data.index(b"\n\n") + 2
    path.write_bytes(data[:start] + gzip.compress(gzip.decompress(data[start:]) + bytes(256 << 20), 1))
    assert np.array_equal(LABEL_FORMATS["seg-nrrd"].read(path, SHAPE, NAMES).read(2), three_classes().read(2))
