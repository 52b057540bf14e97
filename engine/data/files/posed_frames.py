"""Frames whose cameras another program has found: one lens, a pose each, and distortion that is taken out of the pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from degense.engine.camera import Camera
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import check_rotations, clip_cameras
from degense.engine.data.files.images import ImageFiles
from degense.engine.data.files.labels import index_maps, read_classes
from degense.engine.data.files.masks import border_words, brightest, field_of_view
from degense.engine.data.files.numbered import natural_key, regular_file, shown
from degense.engine.data.files.remapped import RemappedFrames
from degense.engine.data.files.stored import StoredClip, clip_with_prior, counted, looked_at, map_words
from degense.engine.errors import ClipError

MOST_SIDE, MOST_FRAMES = 1 << 16, 100_000


@dataclass(frozen=True)
class Lens:
    """A pinhole with OpenCV's distortion; pixels of a picture of a size, whose first pixel has its centre at (0.5, 0.5)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()  # k1, k2, p1, p2, k3, k4, k5, k6, as far as they go


@dataclass(frozen=True)
class PosedFrame:
    """A picture and where its camera stood."""

    file: Path
    viewmat: np.ndarray  # float64 [4, 4], world to camera, x right, y down, z forward
    lens: Lens


def open_posed(path: Path, frames: Sequence[PosedFrame], source: Path, options: ClipOptions, nearness: float | None = None) -> StoredClip:
    """A clip of pictures with poses from the file `source`, whose lengths are divided by `nearness`: the median depth of what is seen.

    Label maps and strokes may lie beside, as in a folder of frames. ClipError when they do not fit, or there are several lenses.
    """
    if not 1 <= len(frames) <= MOST_FRAMES:
        raise ClipError(f"{shown(source)} has poses of {len(frames)} pictures; a clip has 1 to {MOST_FRAMES}.")
    frames = sorted(frames, key=lambda frame: natural_key(frame.file))
    if len({frame.lens for frame in frames}) > 1:
        raise ClipError(f"{shown(source)} has several lenses; reconstruct the cameras again with one lens for all pictures.")
    files = [regular_file(frame.file, path) for frame in frames]
    stored = ImageFiles(files)
    lens = _scaled(frames[0].lens, stored.size, source)
    matrices = np.stack([frame.viewmat for frame in frames])
    check_rotations(matrices[:, :3, :3], source)
    viewmats = matrices @ np.linalg.inv(matrices[0])
    viewmats[:, :3, 3] /= nearness or 1.0
    bent = any(lens.distortion)
    pictures = RemappedFrames(stored, (slice(None), slice(None)), _straightened(lens)) if bent else stored
    some = [pictures.read(i) for i in looked_at(len(files))]
    field = field_of_view(brightest(some))
    focal = (options.focal, options.focal) if options.focal else (lens.fx, lens.fy)
    words = f"{focal[0]:.6g} pixels, " + ("as set" if options.focal else f"from {source.name}")
    cameras = [Camera(*stored.size, *focal, lens.cx, lens.cy, viewmat) for viewmat in viewmats]
    scale = "whose points have a median depth of 1" if nearness else "in the scale of that file"
    found = clip_cameras(cameras, f"the camera moves, from {source.name}, {scale}", words, options)
    labels, strokes = (None if bent else index_maps(path, files, stored.size, folder) for folder in ("labels", "strokes"))
    told = {"frames": counted(files, stored.size) + (", distortion taken out" if bent else ""), "masks": border_words(field, "dark border")}
    told |= map_words(labels, len(files), "labels") | map_words(strokes, len(files), "strokes")
    if bent and (path / "labels").is_dir():
        told["labels"] = "not read: they would not fit the frames without distortion; undistort both beforehand"
    names = path / "classes.json"
    classes = read_classes(regular_file(names, path)) if names.exists() else ()
    return clip_with_prior(path, pictures, some, field, found, told, label_maps=labels, stroke_maps=strokes, classes=classes)


def checked_lens(lens: Lens, source: Path) -> Lens:
    """The lens, when it can be one. ClipError otherwise."""
    sides = 0 < lens.width <= MOST_SIDE and 0 < lens.height <= MOST_SIDE
    numbers = (lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion)
    if not sides or not all(math.isfinite(number) for number in numbers) or lens.fx <= 0 or lens.fy <= 0 or len(lens.distortion) > 8:
        raise ClipError(f"{shown(source)} has a lens without a size or focal length, or with numbers that are none.")
    return lens


def _scaled(lens: Lens, size: tuple[int, int], source: Path) -> Lens:
    """The lens for pictures that are smaller or larger than it was made for."""
    checked_lens(lens, source)
    x, y = size[0] / lens.width, size[1] / lens.height
    if abs(x / y - 1) > 0.02:
        told = f"{lens.width} × {lens.height} pixels, but the frames are {size[0]} × {size[1]}"
        raise ClipError(f"{shown(source)} is for {told}; use the pictures that it was made from.")
    return Lens(*size, lens.fx * x, lens.fy * y, lens.cx * x, lens.cy * y, lens.distortion)


def _straightened(lens: Lens) -> np.ndarray:
    """Where each pixel of the pinhole is in the picture as it was taken, float32 [H, W, 2]; OpenCV has pixel centres at whole numbers."""
    matrix = np.array([[lens.fx, 0, lens.cx - 0.5], [0, lens.fy, lens.cy - 0.5], [0, 0, 1]])
    bends = np.zeros(8)
    bends[: len(lens.distortion)] = lens.distortion
    maps = cv2.initUndistortRectifyMap(matrix, bends, None, matrix, (lens.width, lens.height), cv2.CV_32FC1)
    places: np.ndarray = np.nan_to_num(np.stack(maps, -1), nan=-1e4, posinf=-1e4, neginf=-1e4)
    return places
