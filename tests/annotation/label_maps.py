"""Label maps in memory, to be written in the formats of other tools."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from degense.engine.annotation.edits import LabelClass, named_classes
from degense.engine.annotation.formats import LABEL_FORMATS, MapSet
from degense.engine.clip import UNLABELLED

SHAPE, NAMES = (48, 64), tuple(f"frame_{i:03d}" for i in range(4))


COCO_ONE = {
    "images": [{"id": 7, "file_name": "images/frame_001.jpg", "width": 64, "height": 48}],
    "categories": [{"id": 3, "name": "fat"}, {"id": 9, "name": "hook"}],
}


def blobs(seed: int, classes: int) -> np.ndarray:
    """Labels with parts, holes, single pixels and islands."""
    random = np.random.default_rng(seed)
    coarse = random.integers(0, classes + 1, (12, 16))
    labels = np.where(coarse == classes, UNLABELLED, coarse).astype(np.uint8).repeat(4, 0).repeat(4, 1)
    specks = random.random(SHAPE) < 0.03
    labels[specks] = random.integers(0, classes, specks.sum())
    labels[10:30, 10:40] = 0
    labels[15:25, 15:35] = 1
    labels[18:22, 18:30] = UNLABELLED
    labels[0, 0] = labels[-1, -1] = 1
    return labels


def maps_of(classes: tuple[LabelClass, ...]) -> MapSet:
    return MapSet(classes, SHAPE, NAMES, (0, 2, 3), lambda frame: blobs(frame, len(classes)))


def three_classes() -> MapSet:
    return maps_of(named_classes(("Grasper", "gallbladder, 'inner' \"wall\"", "Fett: weiß & <gelb>")))


def read_all(name: str, path: Path) -> None:
    """Read every label map of a file."""
    found = LABEL_FORMATS[name].read(path, SHAPE, NAMES)
    for frame in found.frames:
        found.read(frame)
