"""Label Studio: one JSON file with a task for each frame, and brush masks in its own run lengths; polygons and boxes are read too.

Each object is a region; the second and further ones of a class say so in their notes (“object 2”). The run lengths are those of the
JavaScript package rle-pack, of pictures with four equal channels.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from degense.engine.annotation.edits import LabelClass, default_colour
from degense.engine.annotation.formats.map_set import MapSet, check_picture_size, checked_classes, drawn, frame_of, read_text
from degense.engine.annotation.painting import PixelRegion, polygon, region_of
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError, what_is_wrong
from degense.engine.files import write_text
from degense.engine.untrusted import parse_json

#: Names of the tags in the labelling configuration: `<BrushLabels name="label" toName="image">` and `<Image name="image" value="$image"/>`.
TAG, IMAGE = "label", "image"
#: Bits that give the length of a run: it is at most 2 ** bits.
RUN_BITS = (3, 4, 8, 16)
OBJECT = re.compile(r"object ([1-9]\d{0,2})")
KINDS = {"brushlabels", "polygonlabels", "rectanglelabels"}


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`; yields the frames done. The first task's `meta` names the classes with their colours."""
    height, width = maps.shape
    classes = [{"value": k.name, "object": k.number, "background": "#{:02x}{:02x}{:02x}".format(*k.colour)} for k in maps.classes]
    tasks: list[dict[str, Any]] = []
    for frame in maps.frames:
        labels, result = maps.read(frame), []
        for index in np.unique(labels[labels < len(maps.classes)]).tolist():
            value = {"format": "rle", "rle": encode(labels == index), "brushlabels": [maps.classes[index].name]}
            about = {"id": f"{frame}-{index}", "type": "brushlabels", "from_name": TAG, "to_name": IMAGE, "image_rotation": 0}
            if maps.classes[index].number > 1:
                about["meta"] = {"text": [f"object {maps.classes[index].number}"]}
            result.append({**about, "original_width": width, "original_height": height, "value": value})
        task = {"id": frame + 1, "data": {IMAGE: f"{maps.names[frame]}.png"}, "annotations": [{"result": result}]}
        tasks.append(task if tasks else {**task, "meta": {"labels": classes}})
        yield frame
    write_text(out, json.dumps(tasks))


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The regions of a file, later ones on top; of several annotations of a task the first counts. ClipError when they do not fit."""
    found: dict[int, list[tuple[tuple[str, int], Any]]] = {}
    classes: dict[tuple[str, int], LabelClass] = {}
    try:
        for task in parse_json(read_text(path)):
            frame = frame_of(unquote(str(task["data"][IMAGE])), names, path)
            done: Any = next((item for item in task.get("annotations", []) if not item.get("was_cancelled")), {"result": []})
            found[frame] = [(_object(item), item) for item in done["result"] if item.get("type") in KINDS]
            for item in (task.get("meta") or {}).get("labels", []):
                key = str(item["value"]), int(item.get("object", 1))
                classes[key] = LabelClass(key[0], _colour(item["background"]), key[1])
            for key, _ in found[frame]:
                classes.setdefault(key, LabelClass(key[0], default_colour(len(classes)), key[1]))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, RecursionError) as error:
        raise ClipError(f"{shown(path)} is not a Label Studio export that can be read ({what_is_wrong(error)}).") from error
    index = {key: value for value, key in enumerate(classes)}

    def labels(frame: int) -> np.ndarray:
        return drawn(shape, ((_region(item, shape, path), index[key]) for key, item in found[frame]))

    return MapSet(checked_classes(classes.values(), path), shape, tuple(names), tuple(sorted(found)), labels)


def _object(item: Any) -> tuple[str, int]:
    """Class and number of a region."""
    texts = (item.get("meta") or {}).get("text") or [""]
    found = OBJECT.fullmatch(str(texts[0]))
    return str(item["value"][item["type"]][0]), int(found[1]) if found else 1


def _region(item: Any, shape: tuple[int, int], path: Path) -> PixelRegion | None:
    try:
        check_picture_size((item["original_width"], item["original_height"]), shape, path)
        value, (height, width) = item["value"], shape
        if item["type"] == "brushlabels":
            return region_of(decode(value["rle"], shape))
        if item["type"] == "polygonlabels":
            return polygon([(float(x) * width / 100, float(y) * height / 100) for x, y in value["points"]], shape)
        if value.get("rotation"):
            raise ValueError("a turned box")
        x, y, right, down = (float(value[key]) for key in ("x", "y", "width", "height"))
        corners = [(x, y), (x + right, y), (x + right, y + down), (x, y + down)]
        return polygon([(u * width / 100, v * height / 100) for u, v in corners], shape)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ClipError(f"{shown(path)} has a region that cannot be read ({what_is_wrong(error)}).") from error


def encode(mask: np.ndarray) -> list[int]:
    """Bytes of a mask bool [H, W]: 255 inside, 0 outside, in each of four channels."""
    flat = mask.ravel()
    starts = np.flatnonzero(np.diff(flat, prepend=~flat[:1]))
    bits = [f"{4 * flat.size:032b}{8 - 1:05b}", *(f"{size - 1:04b}" for size in RUN_BITS)]
    for start, end in zip(starts.tolist(), [*starts[1:].tolist(), flat.size], strict=True):
        value = "1" * 8 if flat[start] else "0" * 8
        left = 4 * (end - start)
        while left:
            run = min(left, 1 << RUN_BITS[-1])
            kind = next(kind for kind, size in enumerate(RUN_BITS) if run <= 1 << size)
            bits.append(f"1{kind:02b}{run - 1:0{RUN_BITS[kind]}b}{value}")
            left -= run
    text = "".join(bits)
    text += "0" * (-len(text) % 8)
    return [int(text[place : place + 8], 2) for place in range(0, len(text), 8)]


def decode(data: Any, shape: tuple[int, int]) -> np.ndarray:
    """bool [H, W] of bytes as `encode` or Label Studio write them: where the last channel is above 127. ValueError for anything else."""
    pixels = shape[0] * shape[1]
    if not isinstance(data, list) or len(data) > 32 + 6 * pixels or not all(type(byte) is int and 0 <= byte < 256 for byte in data):
        raise ValueError("no run lengths of this picture")
    bits = "".join(f"{byte:08b}" for byte in data)
    place = 0

    def take(count: int) -> int:
        nonlocal place
        if place + count > len(bits):
            raise ValueError("run lengths that end too early")
        place += count
        return int(bits[place - count : place], 2)

    if take(32) != 4 * pixels or take(5) != 8 - 1:
        raise ValueError("run lengths of another picture")
    sizes = [take(4) + 1 for _ in range(4)]
    flat, done = np.empty(4 * pixels, np.uint8), 0
    while done < flat.size:
        repeated, count = take(1), 1
        count += take(sizes[take(2)])
        if done + count > flat.size:
            raise ValueError("run lengths of more pixels than there are")
        flat[done : done + count] = take(8) if repeated else [take(8) for _ in range(count)]
        done += count
    return flat.reshape(*shape, 4)[..., 3] > 127


def _colour(text: Any) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(str(text).removeprefix("#"))
    return red, green, blue
