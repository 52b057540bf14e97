"""YOLO segments: `data.yaml` with the names, and for each frame `labels/NAME.txt` with one polygon a line, in shares of the picture.

A polygon has no holes: parts with holes are cut into pieces without, so that what is written is read again to the pixel.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from degense.engine.annotation.edits import named_classes
from degense.engine.annotation.formats.map_set import MapSet, checked_classes, drawn, frame_of, read_text
from degense.engine.annotation.painting import PixelRegion, polygon
from degense.engine.data.files.numbered import list_files, regular_file, shown
from degense.engine.errors import ClipError
from degense.engine.files import write_text
from degense.engine.untrusted import parse_yaml

MOST_YAML = 1 << 20  # bytes of data.yaml


def write(maps: MapSet, out: Path) -> Iterator[int]:
    """Write into the folder `out`; yields the frames that are done."""
    height, width = maps.shape
    maps = maps.by_class()
    for frame in maps.frames:
        labels, lines = maps.read(frame), []
        for index in range(len(maps.classes)):
            for outline in outlines(labels == index):
                shares = (outline + 0.5) / (width, height)
                lines.append(" ".join([str(index), *(f"{share:.8g}" for share in shares.ravel())]))
        write_text(out / "labels" / f"{maps.names[frame]}.txt", "\n".join(lines) + ("\n" if lines else ""))
        yield frame
    names = "".join(f"  {index}: {json.dumps(kind.name, ensure_ascii=False)}\n" for index, kind in enumerate(maps.classes))
    write_text(out / "data.yaml", f"path: .\ntrain: images\nval: images\nnames:\n{names}")


def read(path: Path, shape: tuple[int, int], names: Sequence[str]) -> MapSet:
    """The polygons of a folder; later lines are on top. ClipError when they do not fit the clip."""
    yaml = path / "data.yaml"
    if not yaml.exists():
        raise ClipError(f"{shown(path)} has no data.yaml that names the classes; choose the folder that holds it.")
    if regular_file(yaml, path).stat().st_size > MOST_YAML:
        raise ClipError(f"{shown(yaml)} is larger than {MOST_YAML >> 20} MB, which is no list of classes.")
    classes = checked_classes(named_classes(_names(read_text(yaml), yaml)), yaml)
    files = {frame_of(file.name, names, file): file for file in list_files(path / "labels", path, (".txt",))}
    if not files:
        raise ClipError(f"{shown(path / 'labels')} holds no .txt files.")

    def segments(frame: int) -> Iterator[tuple[PixelRegion | None, int]]:
        for number, line in enumerate(read_text(files[frame]).splitlines(), 1):
            if not line.strip():
                continue
            try:
                index, *shares = line.split()
                corners = np.array([float(share) for share in shares]).reshape(-1, 2)
                if not 0 <= int(index) < len(classes) or not ((corners >= 0) & (corners <= 1)).all():
                    raise ValueError("a class or a corner that there is not")
                yield polygon([(x * shape[1], y * shape[0]) for x, y in corners.tolist()], shape), int(index)
            except ValueError as error:
                raise ClipError(f"{shown(files[frame])}, line {number}, is no YOLO segment ({error}).") from error

    return MapSet(classes, shape, tuple(names), tuple(sorted(files)), lambda frame: drawn(shape, segments(frame)))


def outlines(mask: np.ndarray) -> Iterator[np.ndarray]:
    """Polygons int [n, 2] of (x, y) pixels, n ≥ 3, whose insides, edges included, are together just the mask bool [H, W]."""
    count, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    for part in range(1, count):
        yield from _without_holes(parts == part)


def _without_holes(part: np.ndarray) -> Iterator[np.ndarray]:
    contours, tree = cv2.findContours(part.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    hole = next((contour for contour, relation in zip(contours, tree[0], strict=True) if relation[3] >= 0), None)
    if hole is None:
        corners = contours[0][:, 0]
        yield np.concatenate([corners, corners[:1].repeat(max(0, 3 - len(corners)), 0)])
        return
    column = int(hole[:, 0, 0].min()) + 1  # through the hole: either side has one hole less
    for side in (slice(None, column), slice(column, None)):
        half = np.zeros_like(part)
        half[:, side] = part[:, side]
        yield from outlines(half)


def _names(text: str, path: Path) -> list[str]:
    """The classes under `names:` of a data.yaml, a list or a mapping from 0, 1, 2, …."""
    try:
        names = parse_yaml(text)["names"]
        listed = list(names) if isinstance(names, list) else [names[str(index)] for index in range(len(names))]
    except (KeyError, TypeError, ValueError, RecursionError):
        listed = []
    if not listed or not all(isinstance(name, str) for name in listed):
        raise ClipError(f"{shown(path)} does not list its classes under names: as 0, 1, 2, ….")
    return listed
