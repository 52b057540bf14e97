"""CVAT for video 1.1: one XML file, in which each part of an object is a track of polygons.

CVAT keeps of a track of masks the first frame only, so masks are written as polygons without holes whose insides, edges included, are just
the masks. Tracks of one object form a group. What is read may be a track of polygons, boxes or masks; tracks of one label that are never
seen together are one object, others are further objects of the class.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from degense.engine.annotation.formats.cvat import declared_classes, describe_labels, number, read_xml, region_of_shape, write_xml
from degense.engine.annotation.formats.map_set import MapSet, check_picture_size, drawn
from degense.engine.annotation.formats.yolo import outlines
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`; yields the frames done."""
    height, width = maps.shape
    root = Element("annotations")
    SubElement(root, "version").text = "1.1"
    task = SubElement(SubElement(root, "meta"), "task")
    SubElement(task, "size").text = str(len(maps.names))
    SubElement(task, "mode").text = "interpolation"
    describe_labels(task, maps.classes, "polygon")
    size = SubElement(task, "original_size")
    SubElement(size, "width").text, SubElement(size, "height").text = str(width), str(height)
    parts: dict[int, list[dict[int, np.ndarray]]] = defaultdict(list)  # of each class its tracks: corners by frame
    for frame in maps.frames:
        labels = maps.read(frame)
        for index in np.unique(labels[labels < len(maps.classes)]).tolist():
            for place, corners in enumerate(sorted(outlines(labels == index), key=len, reverse=True)):
                if place == len(parts[index]):
                    parts[index].append({})
                parts[index][place][frame] = corners
        yield frame
    for index, tracks in sorted(parts.items()):
        for corners_of in tracks:
            about = {"id": str(len(root) - 2), "label": maps.classes[index].name, "source": "manual", "group_id": str(index + 1)}
            _write_track(SubElement(root, "track", about), corners_of, maps)
    write_xml(root, out)


def _write_track(track: Element, corners_of: dict[int, np.ndarray], maps: MapSet) -> None:
    """A key frame for each frame, and one with the track outside the picture wherever it is not seen in the next frame."""
    last: np.ndarray | None = None
    for frame in range(len(maps.names)):
        corners = corners_of.get(frame)
        if corners is None and last is None:
            continue
        points = ";".join(f"{x + 0.5:.2f},{y + 0.5:.2f}" for x, y in (corners if corners is not None else last).tolist())  # type: ignore[union-attr]
        outside = str(int(corners is None))
        SubElement(track, "polygon", frame=str(frame), keyframe="1", outside=outside, occluded="0", points=points, z_order="0")
        last = corners


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The tracks of a file, shapes of higher `z_order` on top. ClipError when they do not fit the clip."""
    root = read_xml(path)
    tracks = root.findall("track")
    if not tracks:
        raise ClipError(f"{shown(path)} has no tracks; export “CVAT for video 1.1”, or read it as CVAT for images.")
    size = root.find(".//original_size")
    if size is not None:
        check_picture_size((_whole(size, "width", path), _whole(size, "height", path)), shape, path)
    numbers = _objects(tracks, len(names), path)
    classes = declared_classes(root, path, ((track.get("label", ""), which) for track, which in zip(tracks, numbers, strict=True)))
    index = {(kind.name, kind.number): value for value, kind in enumerate(classes)}
    found: dict[int, list[tuple[Element, int]]] = defaultdict(list)
    for track, which in zip(tracks, numbers, strict=True):
        for item in track:
            if item.get("outside") != "1":
                found[_frame(item, len(names), path)].append((item, index[track.get("label", ""), which]))

    def labels(frame: int) -> np.ndarray:
        items = sorted(found[frame], key=lambda pair: number(pair[0], "z_order", path, 0))
        return drawn(shape, ((region_of_shape(item, shape, path), value) for item, value in items))

    return MapSet(classes, shape, tuple(names), tuple(sorted(found)), labels)


def _objects(tracks: Sequence[Element], count: int, path: Path) -> list[int]:
    """For each track the number of its object in its class: the first whose other tracks are never seen in the same frame."""
    seen: dict[tuple[str, str], set[int]] = defaultdict(set)
    keys = [(track.get("label", ""), track.get("group_id") or f"track {place}") for place, track in enumerate(tracks)]
    for key, track in zip(keys, tracks, strict=True):
        seen[key] |= {_frame(item, count, path) for item in track if item.get("outside") != "1"}
    taken: dict[str, list[set[int]]] = defaultdict(list)
    numbers: dict[tuple[str, str], int] = {}
    for (label, group), frames in seen.items():
        free = next((place for place, others in enumerate(taken[label]) if not others & frames), len(taken[label]))
        if free == UNLABELLED:
            raise ClipError(f"{shown(path)} has more than {UNLABELLED} objects “{label}” in one frame, which a label map cannot hold.")
        if free == len(taken[label]):
            taken[label].append(set())
        taken[label][free] |= frames
        numbers[label, group] = free + 1
    return [numbers[key] for key in keys]


def _frame(item: Element, count: int, path: Path) -> int:
    frame = number(item, "frame", path)
    if not 0 <= frame < count:
        raise ClipError(f"{shown(path)} has a shape in frame {frame}, but the clip has {count} frames.")
    return frame


def _whole(size: Element, key: str, path: Path) -> int:
    text = size.findtext(key, "")
    if not text.isascii() or not text.isdigit() or len(text) > 9:
        raise ClipError(f"{shown(path)}: the {key} of its pictures is {text!r}, but must be a whole number.")
    return int(text)
