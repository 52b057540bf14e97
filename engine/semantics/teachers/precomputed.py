"""The teacher that reads features which another program computed, in the layouts of the peers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.stored import StoredClip
from degense.engine.errors import ClipError
from degense.engine.semantics.teachers.feature_files import Segments, feature_files
from degense.engine.semantics.teachers.teacher import Targets, enlarged
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.semantics.text.text_vectors import TextVectors

#: Folders beside a clip in which peers leave features.
PLACES = ("language_features_agg", "language_features_fine", "language_features", "sam_embeddings", "features")
TEXT_VECTORS = "text_vectors.safetensors"


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
        kinds = {file.kind for file in self._files.values()}
        if len(kinds) > 1:
            raise ClipError(f"{shown(folder)} mixes {' and '.join(sorted(kinds))}; keep one kind of features in a folder.")
        first = self._files[self.frames[0]]
        self.pixelwise = first.kind == Segments.kind
        self._clip, self._level = clip, level
        first.read(self.encoder.dimension, level)  # raises before the training begins
        used = f"{len(self.frames)} of {len(clip.train_frames)} training frames"
        self.provenance = f"{first.words(level)} from {shown(folder)}: {used}, text vectors of {self.encoder.name}"

    def targets(self, frame: int) -> Targets | None:
        """Unit vectors float32 [k, D] and index map int32 [H, W]; None for other frames. ClipError for a file that does not fit."""
        if frame not in self._files:
            return None
        file = self._files[frame]
        read = file.read(self.encoder.dimension, self._level)
        _check_proportions(read.index, self._clip.size, file.path)
        index = enlarged(read.index, self._clip.size)
        length = np.linalg.norm(read.vectors, axis=1)
        index = np.where(self._clip.valid(frame) & (length > 0)[index] & (index >= 0), index, -1)
        return (read.vectors / np.maximum(length, 1e-12)[:, None]).astype(np.float32), index.astype(np.int32)


def find_features(clip: Clip) -> Path:
    """The folder of features beside a clip. ClipError when there is none, or several."""
    root = clip.path if clip.path.is_dir() else clip.path.parent
    found = [root / name for name in PLACES if (root / name).is_dir()]
    if len(found) != 1:
        there = f"holds {', '.join(folder.name for folder in found)}" if found else f"holds none of {', '.join(PLACES)}"
        raise ClipError(f"{shown(root)} {there}; name the folder of features, as in --teacher precomputed:FOLDER.")
    return found[0]


def frame_names(clip: Clip) -> list[str]:
    """What files that belong to a frame are named: as its picture, or by its number where the clip is one file."""
    if isinstance(clip, StoredClip) and len(clip.pictures.files) == len(clip):
        return [file.stem for file in clip.pictures.files]
    return [f"{i:06d}" for i in range(len(clip))]


def _check_proportions(index: np.ndarray, size: tuple[int, int], path: Path) -> None:
    """ClipError unless an index map [h, w] has the proportions of frames of (width, height)."""
    width, height = size
    rows, columns = index.shape
    square = rows == columns  # encoders that squeeze the frame into a square
    if not square and abs(columns / rows / (width / height) - 1) > max(0.02, 1.5 / min(rows, columns)):
        raise ClipError(f"{shown(path)} is {columns} × {rows}, which is not the shape of the frames ({width} × {height}).")
