"""A sparse model of COLMAP: lenses, poses of pictures and the points that were seen, from binary (`.bin`) or text (`.txt`) files.

Counts and lengths are checked against the size of the file before anything of that size is made.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from degense.engine.data.files.numbered import regular_file, shown
from degense.engine.data.files.posed_frames import Lens
from degense.engine.errors import ClipError

MOST_BYTES, MOST_NAME = 1 << 30, 1000
#: Number, name and number of parameters of each camera model that is a pinhole with OpenCV's distortion.
MODELS = {0: ("SIMPLE_PINHOLE", 3), 1: ("PINHOLE", 4), 2: ("SIMPLE_RADIAL", 4), 3: ("RADIAL", 5), 4: ("OPENCV", 8), 6: ("FULL_OPENCV", 12)}
PARAMETERS = dict(MODELS.values())


@dataclass(frozen=True)
class SparseModel:
    """What is used of a model."""

    lenses: dict[int, Lens]
    pictures: dict[str, tuple[np.ndarray, int]]  # world-to-camera matrix, float64 [4, 4], and number of the lens, by the picture's name
    points: np.ndarray  # float64 [N, 3]


class _Bytes:
    """A file of numbers, read from its start to its end. ClipError where it ends too early."""

    def __init__(self, file: Path) -> None:
        self._file, self._data, self._at = file, file.read_bytes(), 0

    def take(self, form: str) -> tuple[Any, ...]:
        size = struct.calcsize(form)
        self.skip(size)
        return struct.unpack_from(form, self._data, self._at - size)

    def skip(self, size: int) -> None:
        if size > len(self._data) - self._at:
            raise ClipError(f"{shown(self._file)} is cut short or damaged; copy it again.")
        self._at += size

    def count(self, least: int) -> int:
        """A number of entries, of `least` bytes each."""
        (number,) = self.take("<Q")
        if number * least > len(self._data) - self._at:
            raise ClipError(f"{shown(self._file)} promises {number} entries, more than it holds; copy it again.")
        return int(number)

    def name(self) -> str:
        end = self._data.find(b"\0", self._at, self._at + MOST_NAME + 1)
        if end < 0:
            raise ClipError(f"{shown(self._file)} holds a picture's name that has no end; it is damaged.")
        text = self._data[self._at : end]
        self._at = end + 1
        return text.decode("utf-8", "replace")


def read_sparse(folder: Path, root: Path) -> SparseModel:
    """The model in a folder of a clip. ClipError when it is damaged, or has a lens that is none of `MODELS`."""
    binary = (folder / "images.bin").exists()
    files = [regular_file(folder / f"{name}.{'bin' if binary else 'txt'}", root) for name in ("cameras", "images", "points3D")]
    for file in files:
        if file.stat().st_size > MOST_BYTES:
            raise ClipError(f"{shown(file)} is larger than {MOST_BYTES >> 30} GB; that is no sparse model of a clip.")
    try:
        model = (_binary if binary else _text)(*files)
    except (ValueError, IndexError, OverflowError) as error:
        raise ClipError(f"{shown(folder)} holds a sparse model that is damaged ({error}); copy it again.") from error
    for name, (viewmat, lens) in model.pictures.items():
        if not np.isfinite(viewmat).all() or lens not in model.lenses:
            raise ClipError(f"{shown(folder)} has no usable pose or lens for {shown(Path(name))}; it is damaged.")
    return model


def _binary(cameras: Path, images: Path, points: Path) -> SparseModel:
    data, lenses = _Bytes(cameras), {}
    for _ in range(data.count(24)):
        number, kind, width, height = data.take("<IiQQ")
        name, length = _model(cameras, MODELS.get(kind, (f"number {kind}", 0)))
        lenses[number] = _lens(name, width, height, data.take(f"<{length}d"))
    data, pictures = _Bytes(images), {}
    for _ in range(data.count(73)):
        _, *pose, lens = data.take("<I7dI")
        pictures[data.name()] = _viewmat(pose), lens
        data.skip(24 * data.count(24))
    data, places = _Bytes(points), []
    for _ in range(data.count(51)):
        places.append(data.take("<Q3d3Bd")[1:4])
        data.skip(8 * data.count(8))
    return SparseModel(lenses, pictures, np.array(places, np.float64).reshape(-1, 3))


def _text(cameras: Path, images: Path, points: Path) -> SparseModel:
    lenses = {}
    for words in (line.split() for line in _lines(cameras) if line.strip()):
        name, length = _model(cameras, (words[1], PARAMETERS.get(words[1], 0)))
        lenses[int(words[0])] = _lens(name, int(words[2]), int(words[3]), tuple(float(word) for word in words[4 : 4 + length]))
    pictures = {}
    for line in _lines(images)[::2]:  # every other line lists what is seen in the picture
        if words := line.split(maxsplit=9):
            pictures[words[9].strip()[:MOST_NAME]] = _viewmat([float(word) for word in words[1:8]]), int(words[8])
    places = [[float(word) for word in line.split()[1:4]] for line in _lines(points) if line.strip()]
    return SparseModel(lenses, pictures, np.array(places, np.float64).reshape(-1, 3))


def _lines(file: Path) -> list[str]:
    return [line for line in file.read_text("utf-8", "replace").splitlines() if not line.startswith("#")]


def _model(file: Path, found: tuple[str, int]) -> tuple[str, int]:
    if not found[1]:
        known = ", ".join(PARAMETERS)
        raise ClipError(f"{shown(file)} has a camera of the model {shown(Path(found[0]))}; undistort the pictures first, or use {known}.")
    return found


def _lens(name: str, width: int, height: int, numbers: tuple[float, ...]) -> Lens:
    """COLMAP's parameters: one focal length or two, the principal point, and distortion in OpenCV's order."""
    single = name in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
    fx, fy, cx, cy = (numbers[0], *numbers[:3]) if single else numbers[:4]
    return Lens(width, height, fx, fy, cx, cy, tuple(numbers[3 if single else 4 :]))


def _viewmat(pose: list[float]) -> np.ndarray:
    """World-to-camera matrix of a quaternion wxyz and a translation; NaN for a quaternion of no length."""
    w, x, y, z = np.array(pose[:4]) / (np.linalg.norm(pose[:4]) or np.nan)
    viewmat = np.eye(4)
    viewmat[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    viewmat[:3, 3] = pose[4:]
    return viewmat
