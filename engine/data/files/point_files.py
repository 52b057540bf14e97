"""Files of points that are followed through a clip: where people or other programs say that they are."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from degense.engine.data.files.numbered import shown
from degense.engine.data.files.numpy_files import npz_headers, read_npz
from degense.engine.data.files.point_trees import START, labels_of, sequence_of, surgt_points, tattoos
from degense.engine.data.files.surgt_case import is_surgt_case
from degense.engine.errors import ClipError
from degense.engine.untrusted import read_json

MOST_BYTES = 1 << 26
MOST_POINTS, MOST_PLACES = 100_000, 10_000_000
FORMATS = (
    "a .json of {frame: [[x, y] or null, …]} as VL-SurgPT has it, a .csv with the columns frame, x, y and, optionally, point, "
    "an .npz with points and occluded as TAP-Vid has it, or the folder of a sequence of STIR, VL-SurgPT or SurgT"
)


class KnownPoints(NamedTuple):
    """Where points are known to be."""

    pixels: np.ndarray  # float64 [K, T, 2]; (x, y); NaN where nothing is said
    hidden: np.ndarray  # bool [K, T]; said not to be seen
    ends: np.ndarray | None = None  # float64 [E, 2]; where points are in the last frame, and nobody knows which (STIR)

    @property
    def queries(self) -> np.ndarray:
        """Frame, x and y of each point where it is first known, float64 [K, 3]."""
        first = np.isfinite(self.pixels[..., 0]).argmax(1)
        return np.c_[first, self.pixels[np.arange(len(first)), first]]

    def paired(self, followed: np.ndarray) -> KnownPoints:
        """The points, each with the end to which it was followed the nearest, as STIR scores them; `followed` are pixels [K, T, 2]."""
        if self.ends is None:
            return self
        nearest = np.linalg.norm(np.nan_to_num(followed[:, -1])[:, None] - self.ends, axis=-1).argmin(1)
        pixels = self.pixels.copy()
        pixels[:, -1] = self.ends[nearest]
        return KnownPoints(pixels, self.hidden)


def read_points(path: Path, frames: int, size: tuple[int, int]) -> KnownPoints:
    """The points of a file, or of a data set's folder, for a clip of so many frames of a size (width, height).

    ClipError when it is none of `FORMATS`, damaged, or names frames that the clip does not have.
    """
    if (folder := sequence_of(path)) is not None:
        if (file := labels_of(folder)) is None:
            return _located(_from_tree(folder, frames, size), folder)
        path = file
    if not path.is_file() or path.stat().st_size > MOST_BYTES:
        raise ClipError(f"{shown(path)} is no file of points of at most {MOST_BYTES >> 20} MB; give {FORMATS}.")
    if path.suffix.lower() == ".npz":
        found = _from_tap_vid(path, frames, size)
    else:
        read = {".json": _from_json, ".csv": _from_csv}.get(path.suffix.lower())
        if read is None:
            raise ClipError(f"{shown(path)} is no file of points; give {FORMATS}.")
        try:
            rows = read(path)
            rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
            whole = (rows[:, :2] == rows[:, :2].round()).all() and (rows[:, 0] < MOST_POINTS).all() and (rows[:, :2] >= 0).all()
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError, csv.Error) as error:
            raise ClipError(f"{shown(path)} is damaged, or not {FORMATS}.") from error
        if not whole or not (rows[:, 1] < frames).all():
            raise ClipError(f"{shown(path)} names frames that the clip does not have; its frames are 0 to {frames - 1}.")
        names, points = np.unique(rows[:, 0], return_inverse=True)
        if len(names) * frames > MOST_PLACES:
            raise ClipError(f"{shown(path)} names {len(names):,} points; in {frames} frames at most {MOST_PLACES // frames:,} are read.")
        found = KnownPoints(np.full((len(names), frames, 2), np.nan), np.zeros((len(names), frames), bool))
        at = points, rows[:, 1].astype(int)
        found.pixels[at], found.hidden[at] = rows[:, 2:], np.isnan(rows[:, 2:]).any(1)
    return _located(found, path)


def points_beside(clip: Path) -> Path | None:
    """What `read_points` takes for a clip beside whose frames its data set keeps points: the folder; None where there are none.

    ClipError for a link that leads out of the folder.
    """
    folder = clip if clip.is_dir() else clip.parent
    return folder if is_surgt_case(folder) or labels_of(folder) or (folder / START).exists() else None


def _located(found: KnownPoints, path: Path) -> KnownPoints:
    """Those points of which something is known. ClipError when there are none."""
    known = np.isfinite(found.pixels[..., 0]).any(1) if len(found.pixels) else np.zeros(0, bool)
    if not known.any():
        raise ClipError(f"{shown(path)} says of no point where it is.")
    return KnownPoints(found.pixels[known], found.hidden[known], found.ends)


def _from_tree(folder: Path, frames: int, size: tuple[int, int]) -> KnownPoints:
    """Points of a case of SurgT or a sequence of STIR."""
    if is_surgt_case(folder):
        return KnownPoints(*surgt_points(folder, frames, size))
    first, ends = tattoos(folder, size)
    pixels = np.full((len(first), frames, 2), np.nan)
    pixels[:, 0] = first
    return KnownPoints(pixels, np.zeros(pixels.shape[:2], bool), ends)


def _from_json(path: Path) -> np.ndarray:
    """Rows of point, frame, x, y: float64 [n, 4]."""
    data = read_json(path, MOST_BYTES)
    absent = (np.nan, np.nan)
    rows = [(k, int(frame), *map(float, point or absent)) for frame, points in data.items() for k, point in enumerate(points)]
    return np.array(rows, np.float64).reshape(-1, 4)


def _from_csv(path: Path) -> np.ndarray:
    """As `_from_json`; without a column `point` every line is a point of its own."""
    with path.open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    rows = [(float(line.get("point") or k), *(float(line[name]) for name in ("frame", "x", "y"))) for k, line in enumerate(lines)]
    return np.array(rows, np.float64).reshape(-1, 4)


def _from_tap_vid(path: Path, frames: int, size: tuple[int, int]) -> KnownPoints:
    """points float [K, T, 2], shares of width and height, and occluded bool [K, T]."""
    headers = npz_headers(path)
    shapes = [headers.get(name, ((), np.dtype("O"))) for name in ("points", "occluded")]
    (shape, kind), (other, flag) = shapes
    if kind.kind != "f" or flag.kind != "b" or shape != (*other, 2) or other[1:] != (frames,) or math.prod(other) > MOST_PLACES:
        raise ClipError(f"{shown(path)} holds no points [K, {frames}, 2] and occluded [K, {frames}] for the {frames} frames of the clip.")
    hidden = read_npz(path, "occluded")
    return KnownPoints(np.where(hidden[..., None], np.nan, read_npz(path, "points").astype(np.float64) * size), hidden)
