"""COCO: one JSON file, an annotation of compressed run lengths for each connected part; polygons and plain run lengths are read too."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pycocotools.mask as coco_mask

from degense.engine.annotation.edits import named_classes
from degense.engine.annotation.formats.map_set import MapSet, check_picture_size, checked_classes, drawn, frame_of, mask_of_runs, read_text
from degense.engine.annotation.painting import polygon, region_of
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError
from degense.engine.files import write_text


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write the file `out`: each connected part of a class in a frame is an annotation, no crowd; yields the frames done."""
    height, width = maps.shape
    annotations: list[dict[str, Any]] = []
    for frame in maps.frames:
        labels = maps.read(frame)
        for index in np.unique(labels[labels < len(maps.classes)]).tolist():
            count, parts = cv2.connectedComponents((labels == index).astype(np.uint8), connectivity=8)
            for part in range(1, count):
                runs = coco_mask.encode(np.asfortranarray(parts == part, np.uint8))
                segmentation = {"size": [height, width], "counts": runs["counts"].decode("ascii")}
                about = {"id": len(annotations) + 1, "image_id": frame, "category_id": index + 1, "iscrowd": 0}
                box = [int(side) for side in coco_mask.toBbox(runs)]
                annotations.append({**about, "area": int(coco_mask.area(runs)), "bbox": box, "segmentation": segmentation})
        yield frame
    data = {
        "info": {"description": "Masks made by DeGense", "date_created": datetime.now(timezone.utc).isoformat(timespec="seconds")},
        "images": [{"id": i, "file_name": f"{maps.names[i]}.png", "width": width, "height": height} for i in maps.frames],
        "categories": [{"id": index + 1, "name": kind.name} for index, kind in enumerate(maps.classes)],
        "annotations": annotations,
    }
    write_text(out, json.dumps(data))


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The masks of a file; where two overlap, the later one is on top. ClipError when they do not fit the clip."""
    try:
        data = json.loads(read_text(path))
        categories = {item["id"]: index for index, item in enumerate(data["categories"])}
        classes = checked_classes(named_classes(str(item["name"]) for item in data["categories"]), path)
        frames: dict[Any, int] = {}
        for image in data["images"]:
            check_picture_size((image["width"], image["height"]), shape, path)
            frames[image["id"]] = frame_of(str(image["file_name"]), names, path)
        found: dict[int, list[tuple[int, Any]]] = defaultdict(list, {frame: [] for frame in frames.values()})
        for item in data["annotations"]:
            found[frames[item["image_id"]]].append((categories[item["category_id"]], item["segmentation"]))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise ClipError(f"{shown(path)} is not a COCO file that can be read ({type(error).__name__}: {error}).") from error

    def labels(frame: int) -> np.ndarray:
        return drawn(shape, ((region_of(_mask(segmentation, shape, path)), index) for index, segmentation in found[frame]))

    return MapSet(classes, shape, tuple(names), tuple(sorted(found)), labels)


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
        raise ClipError(f"{shown(path)} has a mask that cannot be read ({error}).") from error
