"""The teacher that reads features which another program computed, in the layouts of the peers.

The files are of unknown origin: no pickle, and sizes and types are known before anything is allocated.

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

from degense.engine.clip import Clip
from degense.engine.data.files.numbered import list_files, shown
from degense.engine.data.files.numpy_files import open_npy
from degense.engine.data.files.stored import frame_names
from degense.engine.errors import ClipError
from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.teachers.teacher import Targets, enlarged
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.semantics.text.text_vectors import TextVectors

#: Folders beside a clip in which peers leave features.
PLACES = ("language_features_agg", "language_features_fine", "language_features", "sam_embeddings", "features")
TEXT_VECTORS = "text_vectors.safetensors"
MOST_BYTES = 2 << 30  # of one file
MOST_LEVELS = 16
TORCH_ENDING = "_fmap_CxHxW"

#: Vectors float32 [k, D], finite, of any length; and which of them each cell has, int [h, w], −1 = none.
Features = tuple[np.ndarray, np.ndarray]


class PrecomputedTeacher:
    """Targets from feature files named like the frames, and text vectors of the same space, `text_vectors.safetensors`, beside them.

    `level` is of segment maps that have several (LangSplat: default, small, medium, large).

    Raises
    ------
    ClipError
        If the folder holds no features for this clip, or files that do not fit each other.
    DegenseError
        If the text vectors are missing or damaged, or lack a class of the clip.
    """

    def __init__(self, clip: Clip, folder: Path, level: int = 0):
        self.name = f"precomputed:{folder}" + (f"?level={level}" if level else "")
        if not folder.is_dir():
            raise ClipError(f"{shown(folder)} is no folder; name the one that holds the features, as in --teacher precomputed:FOLDER.")
        self.encoder: TextEncoder = TextVectors.read(folder / TEXT_VECTORS).with_classes(clip.classes)
        files = feature_files(folder)
        names = frame_names(clip)
        found = {i: files[names[i]] for i in range(len(clip)) if names[i] in files}
        if not found:
            like = f"such as {names[0]}.npy, {names[0]}_f.npy with {names[0]}_s.npy, {names[0]}_agg.npy or {names[0]}_fmap_CxHxW.pt"
            raise ClipError(f"{shown(folder)} holds no features of this clip; they must be named like its frames, {like}.")
        self.frames = [i for i in clip.train_frames if i in found]
        if not self.frames:
            raise ClipError(f"{shown(folder)} holds features of held-out frames only (1, 9, 17, …); compute them for others too.")
        self._files = {i: found[i] for i in self.frames}
        if len({file.segments for file in self._files.values()}) > 1:
            raise ClipError(f"{shown(folder)} mixes dense features and segment features; keep one kind of features in a folder.")
        first = self._files[self.frames[0]]
        self.pixelwise = first.segments
        self._clip, self._level = clip, level
        first.read(self.encoder.dimension, level)  # raises before the training begins
        used = f"{len(self.frames)} of {len(clip.train_frames)} training frames"
        self.provenance = f"{first.words(level)} from {shown(folder)}: {used}, text vectors of {self.encoder.name}"

    def targets(self, frame: int) -> Targets | None:
        """Unit vectors float32 [k, D] and index map int32 [H, W]; None for other frames. ClipError for a file that does not fit."""
        if frame not in self._files:
            return None
        file = self._files[frame]
        vectors, cells = file.read(self.encoder.dimension, self._level)
        _check_proportions(cells, self._clip.size, file.path)
        index = enlarged(cells, self._clip.size)
        known = np.linalg.norm(vectors, axis=1) > 0
        index = np.where(self._clip.valid(frame) & known[index] & (index >= 0), index, -1)
        return unit_rows(vectors).astype(np.float32), index.astype(np.int32)


def find_features(clip: Clip) -> Path:
    """The folder of features beside a clip. ClipError when there is none, or several."""
    root = clip.path if clip.path.is_dir() else clip.path.parent
    found = [root / name for name in PLACES if (root / name).is_dir()]
    if len(found) != 1:
        there = f"holds {', '.join(folder.name for folder in found)}" if found else f"holds none of {', '.join(PLACES)}"
        raise ClipError(f"{shown(root)} {there}; name the folder of features, as in --teacher precomputed:FOLDER.")
    return found[0]


@dataclass(frozen=True)
class FeatureFile:
    """The features of one frame: a map with one vector a cell, or segment maps with the file of their vectors."""

    path: Path
    vectors: Path | None = None

    @property
    def segments(self) -> bool:
        return self.vectors is not None

    def words(self, level: int) -> str:
        """What it is, for the user."""
        if self.segments:
            return f"segment features (_s.npy and _f.npy, level {level})"
        return f"dense features ({'_agg' if self.path.stem.endswith('_agg') else ''}{self.path.suffix})"

    def read(self, dimension: int, level: int) -> Features:
        """ClipError, naming the file, unless it holds sound vectors of that dimension, and has that level."""
        if self.vectors is not None:
            return _of_segments(open_npy(self.path), self.path, open_npy(self.vectors), self.vectors, dimension, level)
        if self.path.suffix.lower() == ".pt":
            return _of_cells(_torch_map(self.path), dimension, self.path)
        array = open_npy(self.path)
        _check_bytes(array.size * 4, self.path)
        return _of_cells(array, dimension, self.path)


def feature_files(folder: Path) -> dict[str, FeatureFile]:
    """The feature files of a folder by the name of their frame.

    ClipError for links out of the folder, and for segments without vectors or the reverse.
    """
    files: dict[str, FeatureFile] = {}
    arrays = {file.stem: file for file in list_files(folder, folder, (".npy",))}
    for stem, path in arrays.items():
        if stem.endswith("_s"):
            other = arrays.get(stem[:-2] + "_f")
            if other is None:
                raise ClipError(f"{shown(path)} names segments, but {stem[:-2]}_f.npy with their vectors is missing.")
            files[stem[:-2]] = FeatureFile(path, other)
        elif stem.endswith("_f"):
            if stem[:-2] + "_s" not in arrays:
                raise ClipError(f"{shown(path)} holds vectors, but {stem[:-2]}_s.npy with their segments is missing.")
        else:
            files[stem.removesuffix("_agg")] = FeatureFile(path)
    return files | {path.stem.removesuffix(TORCH_ENDING): FeatureFile(path) for path in list_files(folder, folder, (".pt",))}


def _of_segments(maps: np.ndarray, path: Path, vectors: np.ndarray, vectors_path: Path, dimension: int, level: int) -> Features:
    if maps.ndim != 3 or not 1 <= len(maps) <= MOST_LEVELS or maps.size == 0:
        raise ClipError(f"{shown(path)} has the shape {list(maps.shape)}, but segment maps are [levels, height, width].")
    if not 0 <= level < len(maps):
        raise ClipError(f"{shown(path)} has the levels 0 to {len(maps) - 1}, not {level}; choose one of them with ?level=.")
    if vectors.ndim != 2 or vectors.dtype.kind != "f":
        held = f"{vectors.dtype} values of the shape {list(vectors.shape)}"
        raise ClipError(f"{shown(vectors_path)} holds {held}, but vectors are [segments, {dimension}] of floats.")
    _check_dimension(vectors.shape[1], dimension, vectors_path)
    _check_bytes(vectors.size * 4 + maps[level].size * 8, vectors_path)
    chosen = np.asarray(maps[level], np.float64)
    if not (np.isfinite(chosen).all() and (chosen == np.round(chosen)).all() and chosen.min() >= -1 and chosen.max() < len(vectors)):
        raise ClipError(f"{shown(path)} must name segments −1 (none) to {len(vectors) - 1}, the rows of {vectors_path.name}.")
    return _finite(np.asarray(vectors, np.float32), vectors_path), chosen.astype(np.int32)


def _torch_map(path: Path) -> np.ndarray:
    """A saved torch tensor. Only tensors are read: a file that would run code is refused."""
    import torch

    try:
        with zipfile.ZipFile(path) as archive:
            _check_bytes(sum(entry.file_size for entry in archive.infolist()), path)
        loaded = torch.load(path, map_location="cpu", weights_only=True)
    except ClipError:
        raise
    except Exception as error:  # whatever torch meets in a hostile file
        raise ClipError(f"{shown(path)} is not a saved torch tensor, or holds more than tensors; save the feature map alone.") from error
    if not isinstance(loaded, torch.Tensor) or not loaded.is_floating_point() or loaded.layout != torch.strided:
        raise ClipError(f"{shown(path)} holds no tensor of floats; save the feature map [D, h, w] alone.")
    _check_bytes(loaded.numel() * 4, path)  # a stored tensor may repeat its memory
    return loaded.detach().float().numpy()


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
    return _finite(vectors, path), np.arange(rows * columns).reshape(rows, columns)


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


def _check_proportions(index: np.ndarray, size: tuple[int, int], path: Path) -> None:
    """ClipError unless an index map [h, w] has the proportions of frames of (width, height)."""
    width, height = size
    rows, columns = index.shape
    square = rows == columns  # encoders that squeeze the frame into a square
    if not square and abs(columns / rows / (width / height) - 1) > max(0.02, 1.5 / min(rows, columns)):
        raise ClipError(f"{shown(path)} is {columns} × {rows}, which is not the shape of the frames ({width} × {height}).")
