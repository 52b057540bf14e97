"""Raw EndoVis 2018 scene segmentation: a sequence with `left_frames/frameNNN.png`, `labels/frameNNN.png` and `camera_calibration.txt`.

Labels are colour masks of the left view. `labels.json`, in the release folder or beside the frames, names the colours; without it the
challenge's published table does. The right view is not used.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import ClipCameras, calibrated_cameras, guessed_cameras
from degense.engine.data.files.images import ImageFiles
from degense.engine.data.files.labels import ColourCodes, ColourMaps, by_frame, index_maps
from degense.engine.data.files.masks import border_words, brightest, field_of_view
from degense.engine.data.files.numbered import list_files, read_json, regular_file, shown
from degense.engine.data.files.stored import clip_with_prior, colour_map_words, counted, looked_at, map_words
from degense.engine.errors import ClipError

FRAMES = "left_frames"
SIZE = (1280, 1024)  # of the published frames, which the calibration is for

#: name and colour in the published `labels.json`; the place in this table is the `classid`
CLASSES: tuple[tuple[str, tuple[int, int, int]], ...] = (
    ("background-tissue", (0, 0, 0)),
    ("instrument-shaft", (0, 255, 0)),
    ("instrument-clasper", (0, 255, 255)),
    ("instrument-wrist", (125, 255, 12)),
    ("kidney-parenchyma", (255, 55, 0)),
    ("covered-kidney", (24, 55, 125)),
    ("thread", (187, 155, 25)),
    ("clamps", (0, 255, 125)),
    ("suturing-needle", (255, 255, 125)),
    ("suction-instrument", (123, 15, 175)),
    ("small-intestine", (124, 155, 5)),
    ("ultrasound-probe", (12, 255, 141)),
)


def open_endovis18(path: Path, options: ClipOptions) -> Clip:
    """Open one sequence of the raw data set. ClipError when it cannot be read."""
    frames = list_files(path / FRAMES, path)
    if not frames:
        raise ClipError(f"{shown(path / FRAMES)} holds no pictures (frame000.png, …).")
    pictures = ImageFiles(frames)
    size, count = pictures.size, len(frames)
    table, origin = class_table(path)
    names = tuple(name for name, _ in table)
    files = by_frame(list_files(path / "labels", path, (".png",)), frames, size)
    maps = ColourMaps(files, ColourCodes(colour for _, colour in table), size)
    strokes = index_maps(path, frames, size, "strokes", names)
    some = [pictures.read(i) for i in looked_at(count)]
    field = field_of_view(brightest(some))
    words = {
        "frames": counted(frames, size) + ", left view",
        "masks": border_words(field, "dark border"),
        "labels": colour_map_words(maps, count, f"colours of {origin}", "have no class's colour"),
        **map_words(strokes, count, "strokes"),
    }
    classes = names if maps.files or strokes else ()
    cameras = _cameras(path, count, size, field, options)
    found = maps if maps.files else None
    return clip_with_prior(path, pictures, some, field, cameras, words, classes=classes, label_maps=found, stroke_maps=strokes)


def class_table(path: Path) -> tuple[list[tuple[str, tuple[int, int, int]]], str]:
    """Names and colours in the order of their `classid`, and where they come from. ClipError for a `labels.json` that is no such table."""
    for folder in (path, path.parent):
        file = folder / "labels.json"
        if file.exists():
            return _read_table(regular_file(file, folder)), "labels.json"
    return list(CLASSES), "the published table"


def _read_table(file: Path) -> list[tuple[str, tuple[int, int, int]]]:
    form = '[{"name": "thread", "color": [187, 155, 25], "classid": 6}, …]'
    try:
        entries = {int(entry["classid"]): (str(entry["name"]), tuple(int(part) for part in entry["color"])) for entry in read_json(file)}
    except (TypeError, KeyError, ValueError) as error:
        raise ClipError(f"{shown(file)} must look like {form}.") from error
    if not 1 <= len(entries) <= UNLABELLED or sorted(entries) != list(range(len(entries))):
        raise ClipError(f"{shown(file)} must number its classes 0, 1, … without a gap, at most {UNLABELLED}, as {form}.")
    table = [entries[i] for i in range(len(entries))]
    if any(len(colour) != 3 or not all(0 <= part <= 255 for part in colour) for _, colour in table):
        raise ClipError(f"{shown(file)} has a colour that is not three numbers from 0 to 255, as in {form}.")
    if len({colour for _, colour in table}) < len(table) or len({name for name, _ in table}) < len(table):
        raise ClipError(f"{shown(file)} gives two classes one colour or one name; each needs its own.")
    return [(name, (colour[0], colour[1], colour[2])) for name, colour in table]


def _cameras(path: Path, count: int, size: tuple[int, int], field: np.ndarray | None, options: ClipOptions) -> ClipCameras:
    file = path / "camera_calibration.txt"
    if options.focal or not file.exists() or not math.isclose(size[0] / size[1], SIZE[0] / SIZE[1], rel_tol=0.01):
        return guessed_cameras(count, size, field, options)
    return calibrated_cameras(regular_file(file, path), count, size, SIZE, options)
