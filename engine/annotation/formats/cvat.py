"""CVAT for images 1.1: one XML file, masks as run lengths along the rows of their box; polygons and boxes are read too.

The objects of a class are masks of one label in different groups.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from degense.engine.annotation.edits import LabelClass, default_colour
from degense.engine.annotation.formats.map_set import (
    MapSet,
    check_picture_size,
    checked_classes,
    class_names,
    drawn,
    frame_of,
    mask_of_runs,
    read_text,
)
from degense.engine.annotation.painting import PixelRegion, polygon, region_of
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError
from degense.engine.files import write_text


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`: each class in each frame is a mask; yields the frames done."""
    height, width = maps.shape
    root = Element("annotations")
    SubElement(root, "version").text = "1.1"
    describe_labels(SubElement(SubElement(root, "meta"), "task"), maps.classes, "mask")
    for frame in maps.frames:
        image = SubElement(root, "image", id=str(frame), name=f"{maps.names[frame]}.png", width=str(width), height=str(height))
        labels = maps.read(frame)
        for index, kind in enumerate(maps.classes):
            region = region_of(labels == index)
            if region is not None:
                rows, columns = region.mask.shape
                changes = np.flatnonzero(np.diff(region.mask.ravel(), prepend=False))
                runs = ", ".join(map(str, np.diff(changes, prepend=0, append=region.mask.size)))
                mask = SubElement(image, "mask", label=kind.name, source="manual", occluded="0", rle=runs)
                for key, side in (("left", region.left), ("top", region.top), ("width", columns), ("height", rows), ("z_order", 0)):
                    mask.set(key, str(side))
                if kind.number > 1:
                    mask.set("group_id", str(kind.number))
        yield frame
    write_xml(root, out)


def describe_labels(task: Element, classes: Sequence[LabelClass], shapes: str) -> None:
    """Name the labels of a task, each once, in the colours of their first objects; `shapes` is what kind they are drawn with."""
    labels = SubElement(task, "labels")
    for name in class_names(classes):
        label = SubElement(labels, "label")
        SubElement(label, "name").text = name
        colour = next(kind.colour for kind in classes if kind.name.casefold() == name.casefold())
        SubElement(label, "color").text = "#{:02x}{:02x}{:02x}".format(*colour)
        SubElement(label, "type").text = shapes


def write_xml(root: Element, out: Path) -> None:
    ElementTree.indent(root)
    write_text(out, '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n")


def read_xml(path: Path) -> Element:
    """The root of an XML file. ClipError when it is none, or declares entities, which could grow without bounds."""
    text = read_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ClipError(f"{shown(path)} declares XML entities, which no export of CVAT does; it is not read.")
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ClipError(f"{shown(path)} is not XML that can be read: {error}.") from error


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The shapes of a file, those of higher `z_order` on top. ClipError when they do not fit the clip."""
    root = read_xml(path)
    images = {frame_of(image.get("name", ""), names, path): image for image in root.iter("image")}
    if not images:
        raise ClipError(f"{shown(path)} has no images; export “CVAT for images 1.1”, or read it as CVAT for video.")
    items = {(item.get("label", ""), _group(item)) for image in images.values() for item in image}
    classes = declared_classes(root, path, items)
    index = {(kind.name, kind.number): value for value, kind in enumerate(classes)}
    for image in images.values():
        check_picture_size((number(image, "width", path), number(image, "height", path)), shape, path)

    def labels(frame: int) -> np.ndarray:
        items = sorted(images[frame], key=lambda item: number(item, "z_order", path, 0))
        return drawn(shape, ((region_of_shape(item, shape, path), index[item.get("label", ""), _group(item)]) for item in items))

    return MapSet(classes, shape, tuple(names), tuple(sorted(images)), labels)


def declared_classes(root: Element, path: Path, items: Iterable[tuple[str, int]]) -> tuple[LabelClass, ...]:
    """As declared, then what shapes are called beyond that: label and number of each object in `items`."""
    declared = {label.findtext("name", ""): label.findtext("color", "") for label in root.iter("label")}
    wanted = [*((name, 1) for name in declared), *sorted(set(items))]
    classes: list[LabelClass] = []
    for name, group in dict.fromkeys(wanted):
        digits = declared.get(name, "").removeprefix("#") if group == 1 else ""
        known = len(digits) == 6 and all(digit in "0123456789abcdefABCDEF" for digit in digits)
        colour = tuple(bytes.fromhex(digits)) if known else default_colour(len(classes))
        classes.append(LabelClass(name, (colour[0], colour[1], colour[2]), group))
    return checked_classes(classes, path)


def _group(item: Element) -> int:
    """The number of the object that a shape is of: its group, where that is a small number."""
    text = item.get("group_id", "")
    return int(text) if text.isascii() and text.isdigit() and len(text) < 4 and 1 <= int(text) < UNLABELLED else 1


def region_of_shape(item: Element, shape: tuple[int, int], path: Path) -> PixelRegion | None:
    """The pixels of a shape; None for a kind that has no area, such as points."""
    try:
        if item.tag == "mask":
            top, left, height, width = (number(item, key, path) for key in ("top", "left", "height", "width"))
            if min(top, left) < 0 or min(height, width) < 1 or top + height > shape[0] or left + width > shape[1]:
                raise ValueError("a mask outside the picture")
            runs = [int(run) for run in item.get("rle", "").split(",")]  # along the rows: the columns of the transposed mask
            return region_of(mask_of_runs(runs, (width, height)).T, top, left)
        if item.tag == "polygon":
            corners = [corner.split(",") for corner in item.get("points", "").split(";")]
            return polygon([(float(x), float(y)) for x, y in corners], shape)
        if item.tag == "box":
            x0, y0, x1, y1 = (float(item.get(key, "")) for key in ("xtl", "ytl", "xbr", "ybr"))
            return polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], shape)
    except (ValueError, OverflowError) as error:
        raise ClipError(f"{shown(path)} has a {item.tag} that cannot be read ({error}).") from error
    return None


def number(item: Element, key: str, path: Path, default: int | None = None) -> int:
    text = item.get(key)
    if text is None and default is not None:
        return default
    try:
        return int(text or "")
    except ValueError:
        raise ClipError(f"{shown(path)}: {key} of a {item.tag} is {text!r}, but must be a whole number.") from None
