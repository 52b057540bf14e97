"""CVAT for images 1.1: one XML file, masks as run lengths along the rows of their box; polygons and boxes are read too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from degense.engine.annotation.edits import LabelClass, default_colour
from degense.engine.annotation.formats.map_set import MapSet, check_picture_size, checked_classes, drawn, frame_of, mask_of_runs, read_text
from degense.engine.annotation.painting import PixelRegion, polygon, region_of
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError
from degense.engine.files import write_text


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`: each class in each frame is a mask; yields the frames done."""
    height, width = maps.shape
    root = Element("annotations")
    SubElement(root, "version").text = "1.1"
    labels_of_task = SubElement(SubElement(SubElement(root, "meta"), "task"), "labels")
    for kind in maps.classes:
        label = SubElement(labels_of_task, "label")
        SubElement(label, "name").text = kind.name
        SubElement(label, "color").text = "#{:02x}{:02x}{:02x}".format(*kind.colour)
        SubElement(label, "type").text = "mask"
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
                for key, number in (("left", region.left), ("top", region.top), ("width", columns), ("height", rows), ("z_order", 0)):
                    mask.set(key, str(number))
        yield frame
    ElementTree.indent(root)
    write_text(out, '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n")


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The shapes of a file, those of higher `z_order` on top. ClipError when they do not fit the clip."""
    text = read_text(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ClipError(f"{shown(path)} declares XML entities, which no export of CVAT does; it is not read.")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ClipError(f"{shown(path)} is not XML that can be read: {error}.") from error
    images = {frame_of(image.get("name", ""), names, path): image for image in root.iter("image")}
    if not images:
        raise ClipError(f"{shown(path)} has no images; export “CVAT for images 1.1” (a video task can be exported so too).")
    classes = _classes(root, path)
    index = {kind.name: number for number, kind in enumerate(classes)}
    for image in images.values():
        check_picture_size((_number(image, "width", path), _number(image, "height", path)), shape, path)

    def labels(frame: int) -> np.ndarray:
        items = sorted(images[frame], key=lambda item: _number(item, "z_order", path, 0))
        return drawn(shape, ((_region(item, shape, path), index[item.get("label", "")]) for item in items))

    return MapSet(classes, shape, tuple(names), tuple(sorted(images)), labels)


def _classes(root: Element, path: Path) -> tuple[LabelClass, ...]:
    """As declared, then what shapes are called beyond that."""
    declared = {label.findtext("name", ""): label.findtext("color", "") for label in root.iter("label")}
    for image in root.iter("image"):
        for item in image:
            declared.setdefault(item.get("label", ""), "")
    classes: list[LabelClass] = []
    for name, code in declared.items():
        digits = code.removeprefix("#")
        known = len(digits) == 6 and all(digit in "0123456789abcdefABCDEF" for digit in digits)
        colour = tuple(bytes.fromhex(digits)) if known else default_colour(len(classes))
        classes.append(LabelClass(name, (colour[0], colour[1], colour[2])))
    return checked_classes(classes, path)


def _region(item: Element, shape: tuple[int, int], path: Path) -> PixelRegion | None:
    """The pixels of a shape; None for a kind that has no area, such as points."""
    try:
        if item.tag == "mask":
            top, left, height, width = (_number(item, key, path) for key in ("top", "left", "height", "width"))
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


def _number(item: Element, key: str, path: Path, default: int | None = None) -> int:
    text = item.get(key)
    if text is None and default is not None:
        return default
    try:
        return int(text or "")
    except ValueError:
        raise ClipError(f"{shown(path)}: {key} of a {item.tag} is {text!r}, but must be a whole number.") from None
