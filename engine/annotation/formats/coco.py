"""COCO: one JSON file, an annotation of compressed run lengths for each connected part; polygons and plain run lengths are read too.

Of a class with several objects each object is one annotation, and `track_id` is its number.
"""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycocotools.mask as coco_mask

from degense.engine.annotation.edits import LabelClass, default_colour, named_classes
from degense.engine.annotation.formats.map_set import (
    MapSet,
    check_picture_size,
    checked_classes,
    class_names,
    drawn,
    frame_of,
    index_of,
    mask_of_runs,
    read_text,
)
from degense.engine.annotation.painting import polygon, region_of
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError, what_is_wrong
from degense.engine.files import write_text
from degense.engine.untrusted import parse_json


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`: no annotation is a crowd; yields the frames done."""
    height, width = maps.shape
    names = class_names(maps.classes)
    annotations: list[dict[str, Any]] = []
    for frame in maps.frames:
        for kind, mask in _instances(maps.classes, maps.read(frame)):
            about = {"id": len(annotations) + 1, "image_id": frame, "category_id": index_of(kind.name, names) + 1, "iscrowd": 0}
            annotations.append({**about, **_described(mask), **({"track_id": kind.number} if kind.number > 1 else {})})
        yield frame
    data = {
        "info": {"description": "Masks made by DeGense", "date_created": datetime.now(timezone.utc).isoformat(timespec="seconds")},
        "images": [{"id": i, "file_name": f"{maps.names[i]}.png", "width": width, "height": height} for i in maps.frames],
        "categories": [{"id": index + 1, "name": name} for index, name in enumerate(names)],
        "annotations": annotations,
    }
    write_text(out, json.dumps(data))


def _instances(classes: Sequence[LabelClass], labels: np.ndarray) -> Iterator[tuple[LabelClass, np.ndarray]]:
    """Masks bool [H, W] of the objects in a frame; of a class with one object, of its connected parts."""
    objects = Counter(kind.name.casefold() for kind in classes)
    for index in np.unique(labels[labels < len(classes)]).tolist():
        kind, mask = classes[index], labels == index
        if objects[kind.name.casefold()] > 1:
            yield kind, mask
            continue
        count, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
        yield from ((kind, parts == part) for part in range(1, count))


def _described(mask: np.ndarray) -> dict[str, Any]:
    runs = coco_mask.encode(np.asfortranarray(mask, np.uint8))
    segmentation = {"size": list(mask.shape), "counts": runs["counts"].decode("ascii")}
    return {"area": int(coco_mask.area(runs)), "bbox": [int(side) for side in coco_mask.toBbox(runs)], "segmentation": segmentation}


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The masks of a file; where two overlap, the later one is on top. ClipError when they do not fit the clip."""
    try:
        data = parse_json(read_text(path))
        categories = {item["id"]: index for index, item in enumerate(data["categories"])}
        classes = list(checked_classes(named_classes(str(item["name"]) for item in data["categories"]), path))
        objects = {(index, 1): index for index in range(len(classes))}
        frames: dict[Any, int] = {}
        for image in data["images"]:
            check_picture_size((image["width"], image["height"]), shape, path)
            frames[image["id"]] = frame_of(str(image["file_name"]), names, path)
        found: dict[int, list[tuple[int, Any]]] = defaultdict(list, {frame: [] for frame in frames.values()})
        for item in data["annotations"]:
            category, number = categories[item["category_id"]], item.get("track_id", 1)
            if not isinstance(number, int) or not 1 <= number < UNLABELLED:
                number = 1  # a tracker's own number, which may be anything
            if (category, number) not in objects:
                objects[category, number] = len(classes)
                classes.append(LabelClass(classes[category].name, default_colour(len(classes)), number))
            found[frames[item["image_id"]]].append((objects[category, number], item["segmentation"]))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise ClipError(f"{shown(path)} is not a COCO file that can be read ({what_is_wrong(error)}).") from error

    def labels(frame: int) -> np.ndarray:
        return drawn(shape, ((region_of(_mask(segmentation, shape, path)), index) for index, segmentation in found[frame]))

    return MapSet(checked_classes(classes, path), shape, tuple(names), tuple(sorted(found)), labels)


def _mask(segmentation: Any, shape: tuple[int, int], path: Path) -> np.ndarray:
    """bool [H, W] of polygons or run lengths."""
    try:
        if isinstance(segmentation, list):
            mask = np.zeros(shape, bool)
            for outline in segmentation:
                region = polygon(list(zip(outline[0::2], outline[1::2], strict=True)), shape)
                if region is not None:
                    mask[region.box] |= region.mask
            return mask
        if tuple(segmentation["size"]) != shape:
            raise ValueError(f"a mask of size {segmentation['size']}")
        return mask_of_runs(segmentation["counts"], shape)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        raise ClipError(f"{shown(path)} has a mask that cannot be read ({what_is_wrong(error)}).") from error
