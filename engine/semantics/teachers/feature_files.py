"""Feature files of the peers, of unknown origin: no pickle, and sizes and types are known before anything is allocated.

================================  =========================================================================  ==========================
file                              holds                                                                      written by
================================  =========================================================================  ==========================
`FRAME_s.npy` and `FRAME_f.npy`   segment of each pixel [L, H, W], −1 = none, and their vectors [N, D]       LangSplat, SurgTPGS
`FRAME_agg.npy`                   [1, D, h, w] or [1, h, w, D]                                               SurgTPGS++
`FRAME_fmap_CxHxW.pt`             torch tensor [D, h, w]                                                     feature-3dgs, FE-4DGS
`FRAME.npy`                       [D, h, w] or [h, w, D]                                                     anybody
================================  =========================================================================  ==========================
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from degense.engine.data.files.numbered import list_files, shown
from degense.engine.data.files.numpy_files import open_npy
from degense.engine.errors import ClipError

MOST_BYTES = 2 << 30  # of one file
MOST_LEVELS = 16
TORCH_ENDING = "_fmap_CxHxW"


@dataclass(frozen=True)
class Features:
    """Vectors float32 [k, D], finite, of any length; and which of them each cell has, int32 [h, w], −1 = none."""

    vectors: np.ndarray
    index: np.ndarray


def feature_files(folder: Path) -> dict[str, Segments | Maps]:
    """The feature files of a folder by the name of their frame.

    Raises
    ------
    ClipError
        For links out of the folder, and for segments without vectors or the reverse.
    """
    files: dict[str, Segments | Maps] = {}
    arrays = {file.stem: file for file in list_files(folder, folder, (".npy",))}
    for stem, path in arrays.items():
        if stem.endswith("_s"):
            other = arrays.get(stem[:-2] + "_f")
            if other is None:
                raise ClipError(f"{shown(path)} names segments, but {stem[:-2]}_f.npy with their vectors is missing.")
            files[stem[:-2]] = Segments(path, other)
        elif stem.endswith("_f"):
            if stem[:-2] + "_s" not in arrays:
                raise ClipError(f"{shown(path)} holds vectors, but {stem[:-2]}_s.npy with their segments is missing.")
        else:
            files[stem.removesuffix("_agg")] = Maps(path)
    for path in list_files(folder, folder, (".pt",)):
        files[path.stem.removesuffix(TORCH_ENDING)] = TorchMaps(path)
    return files


class Segments:
    """Segment maps and one vector for each segment."""

    kind = "segment features"

    def __init__(self, path: Path, vectors: Path):
        self.path, self._vectors = path, vectors

    def words(self, level: int) -> str:
        """What it is, for the user."""
        return f"{self.kind} (_s.npy and _f.npy, level {level})"

    def read(self, dimension: int, level: int) -> Features:
        """ClipError, naming the file, unless it holds sound vectors of that dimension, and has that level."""
        maps, vectors = open_npy(self.path), open_npy(self._vectors)
        if maps.ndim != 3 or not 1 <= len(maps) <= MOST_LEVELS or maps.size == 0:
            raise ClipError(f"{shown(self.path)} has the shape {list(maps.shape)}, but segment maps are [levels, height, width].")
        if not 0 <= level < len(maps):
            raise ClipError(f"{shown(self.path)} has the levels 0 to {len(maps) - 1}, not {level}; choose one of them with ?level=.")
        if vectors.ndim != 2 or vectors.dtype.kind != "f":
            held = f"{vectors.dtype} values of the shape {list(vectors.shape)}"
            raise ClipError(f"{shown(self._vectors)} holds {held}, but vectors are [segments, {dimension}] of floats.")
        _check_dimension(vectors.shape[1], dimension, self._vectors)
        _check_bytes(vectors.size * 4 + maps[level].size * 8, self._vectors)
        chosen = np.asarray(maps[level], np.float64)
        if not (np.isfinite(chosen).all() and (chosen == np.round(chosen)).all() and chosen.min() >= -1 and chosen.max() < len(vectors)):
            raise ClipError(f"{shown(self.path)} must name segments −1 (none) to {len(vectors) - 1}, the rows of {self._vectors.name}.")
        return Features(_finite(np.asarray(vectors, np.float32), self._vectors), chosen.astype(np.int32))


class Maps:
    """One vector a cell, as a NumPy array."""

    kind = "dense features"

    def __init__(self, path: Path):
        self.path = path

    def words(self, level: int) -> str:
        return f"{self.kind} ({'_agg' if self.path.stem.endswith('_agg') else ''}{self.path.suffix})"

    def read(self, dimension: int, level: int) -> Features:
        array = open_npy(self.path)
        _check_bytes(array.size * 4, self.path)
        return _of_cells(array, dimension, self.path)


class TorchMaps(Maps):
    """One vector a cell, as a saved torch tensor. Only tensors are read: a file that would run code is refused."""

    def words(self, level: int) -> str:
        return f"{self.kind} (.pt)"

    def read(self, dimension: int, level: int) -> Features:
        import torch

        try:
            with zipfile.ZipFile(self.path) as archive:
                _check_bytes(sum(entry.file_size for entry in archive.infolist()), self.path)
            loaded = torch.load(self.path, map_location="cpu", weights_only=True)
        except ClipError:
            raise
        except Exception as error:  # whatever torch meets in a hostile file
            raise ClipError(
                f"{shown(self.path)} is not a saved torch tensor, or holds more than tensors; save the feature map alone."
            ) from error
        if not isinstance(loaded, torch.Tensor) or not loaded.is_floating_point() or loaded.layout != torch.strided:
            raise ClipError(f"{shown(self.path)} holds no tensor of floats; save the feature map [D, h, w] alone.")
        _check_bytes(loaded.numel() * 4, self.path)  # a stored tensor may repeat its memory
        return _of_cells(loaded.detach().float().numpy(), dimension, self.path)


def _of_cells(array: np.ndarray, dimension: int, path: Path) -> Features:
    """Features of an array [D, h, w] or [h, w, D], with or without a leading 1."""
    shape = array.shape
    if array.ndim == 4 and shape[0] == 1:
        array = array[0]
    if array.ndim != 3 or array.size == 0 or array.dtype.kind != "f":
        held = f"{array.dtype} values of the shape {list(shape)}"
        raise ClipError(f"{shown(path)} holds {held}, but a feature map is [D, h, w] or [h, w, D] of floats.")
    first, last = array.shape[0] == dimension, array.shape[2] == dimension
    if first and last:
        raise ClipError(f"{shown(path)} has the shape {list(shape)}: vectors may lie along its first or last axis; save it with w ≠ D.")
    if not first and not last:
        _check_dimension(array.shape[0], dimension, path)
    if first:
        array = np.moveaxis(array, 0, -1)
    rows, columns = array.shape[:2]
    vectors = np.ascontiguousarray(array, np.float32).reshape(-1, dimension)
    return Features(_finite(vectors, path), np.arange(rows * columns, dtype=np.int32).reshape(rows, columns))


def _check_dimension(found: int, dimension: int, path: Path) -> None:
    if found != dimension:
        raise ClipError(
            f"{shown(path)} has vectors of {found} numbers, but the text vectors beside it have {dimension}; both must be of one encoder."
        )


def _check_bytes(size: int, path: Path) -> None:
    if size > MOST_BYTES:
        raise ClipError(
            f"{shown(path)} would take {size / 2**30:.1f} GB of memory, more than {MOST_BYTES >> 30}; save smaller feature maps."
        )


def _finite(vectors: np.ndarray, path: Path) -> np.ndarray:
    if not np.isfinite(vectors).all():
        raise ClipError(f"{shown(path)} holds values that are not numbers; compute it again.")
    if not vectors.any():
        raise ClipError(f"{shown(path)} holds nothing but zeros; compute it again.")
    return vectors
