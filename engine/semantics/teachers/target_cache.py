"""Targets of costly teachers, cached on disk by content: the same clip, settings and versions have the same key.

Every frame is a file of its own, written whole or not at all, so an interrupted teacher resumes where it stopped.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
import platformdirs

from degense.engine.clip import Clip
from degense.engine.data.files.numpy_files import read_npz
from degense.engine.data.readers import fingerprint
from degense.engine.errors import ClipError, DegenseError
from degense.engine.files import replacing, write_text
from degense.engine.progress import Progress, silent
from degense.engine.semantics.teachers.teacher import Described, Targets, Teacher
from degense.engine.untrusted import read_json

FORMAT = 1
LIMIT = 4 << 30  # bytes, unless the user chose otherwise
IN_USE = 3600.0  # seconds since it was last read for which an entry is not removed: a training may be reading it


@runtime_checkable
class CostlyTeacher(Described, Protocol):
    """A teacher whose targets are worth caching: as `Teacher`, but it computes many frames in an order of its own."""

    @property
    def settings(self) -> dict[str, Any]:
        """Everything its targets depend on beside the program itself; JSON values."""
        ...

    def compute(self, frames: Sequence[int], progress: Progress) -> Iterator[tuple[int, Targets | None]]:
        """Targets of these frames, each once, in any order."""
        ...


class CachedTeacher:
    """A costly teacher whose targets are read from disk."""

    def __init__(self, teacher: CostlyTeacher, folder: Path):
        self.name, self.provenance, self.frames = teacher.name, teacher.provenance, teacher.frames
        self.encoder, self.pixelwise, self.folder = teacher.encoder, teacher.pixelwise, folder

    def targets(self, frame: int) -> Targets | None:
        """Vectors and index map of a frame. DegenseError when its file is gone or damaged."""
        if frame not in self.frames:
            return None
        path = self.folder / f"{frame:06d}.npz"
        try:
            vectors, index = read_npz(path, "vectors"), read_npz(path, "index")
            if not _fit(vectors, index):
                raise ClipError("no targets")
        except ClipError as error:
            raise DegenseError(f"{path} is gone or damaged; clear the cache with degense cache --clear and train again.") from error
        os.utime(self.folder)
        return (vectors.astype(np.float32), index.astype(np.int32)) if len(vectors) else None


def _fit(vectors: np.ndarray, index: np.ndarray) -> bool:
    """Whether these are finite vectors [k, D] and a map [H, W] of which each value is one of them, or −1 for none."""
    kinds = vectors.dtype.kind == "f" and index.dtype.kind in "iu" and vectors.ndim == index.ndim == 2
    if not kinds or not np.isfinite(vectors).all():
        return False
    return index.size == 0 or bool(index.min() >= -1 and index.max() < max(1, len(vectors)))


def with_cached_targets(teacher: Teacher | CostlyTeacher, progress: Progress = silent) -> Teacher:
    """A costly teacher after all its frames were computed; those that are in the cache are not computed again. Others as they are.

    `progress` may raise `Cancelled`; what has been computed by then stays.
    """
    if not isinstance(teacher, CostlyTeacher):
        return teacher
    folder = cache_folder() / key_of(teacher.settings)
    missing = [frame for frame in teacher.frames if not (folder / f"{frame:06d}.npz").exists()]
    if missing:
        write_text(folder / "about.json", json.dumps({"teacher": teacher.name, "provenance": teacher.provenance, **teacher.settings}))
        for frame, targets in teacher.compute(missing, progress):
            vectors, index = targets if targets is not None else (np.zeros((0, 1), np.float32), np.zeros((0, 0), np.int32))
            with replacing(folder / f"{frame:06d}.npz") as temporary, temporary.open("wb") as file:
                np.savez_compressed(file, vectors=vectors, index=_smallest(index))
        shrink(keep=folder)
    os.utime(folder)
    return CachedTeacher(teacher, folder)


def clip_settings(clip: Clip) -> dict[str, Any]:
    """The part of a teacher's settings that describes its clip."""
    return {
        "clip": fingerprint(clip),
        "train frames": clip.train_frames,
        "valid": digest(*(clip.valid(frame) for frame in clip.train_frames[:: max(1, len(clip) // 4)])),
        "classes": list(clip.classes),
    }


def key_of(settings: dict[str, Any]) -> str:
    """The name of a cache entry: a digest of the settings, 32 hexadecimal digits."""
    return hashlib.sha256(json.dumps({"format": FORMAT, **settings}, sort_keys=True).encode()).hexdigest()[:32]


def digest(*parts: bytes | np.ndarray) -> str:
    """A digest of contents, 32 hexadecimal digits."""
    total = hashlib.sha256()
    for part in parts:
        raw = part.tobytes() if isinstance(part, np.ndarray) else part
        total.update(f"{len(raw)} ".encode() + raw)
    return total.hexdigest()[:32]


# -- the folder ----------------------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class CacheUse:
    """Entries and bytes of the cache, and the most bytes that it may hold."""

    entries: int
    bytes: int
    limit: int


def cache_folder() -> Path:
    """Where targets are cached; nothing else lies there."""
    return Path(platformdirs.user_cache_dir("degense", appauthor=False)) / "teachers"


def cache_use() -> CacheUse:
    entries = _entries()
    return CacheUse(len(entries), sum(size for _, _, size in entries), _limit())


def set_limit(limit: int) -> None:
    """The most bytes that the cache may hold from now on."""
    write_text(cache_folder() / "limit.json", json.dumps({"bytes": limit}))
    shrink()


def clear_cache() -> CacheUse:
    """Remove all targets; returns what there was."""
    use = cache_use()
    for _, folder, _ in _entries():
        shutil.rmtree(folder)
    return use


def shrink(keep: Path | None = None) -> None:
    """Remove the entries that were not read for longest until the rest fits; never `keep`, nor one that may be in use."""
    entries, now = _entries(), time.time()
    total, limit = sum(size for _, _, size in entries), _limit()
    for used, folder, size in entries:
        if total <= limit:
            return
        if folder != keep and now - used > IN_USE:
            shutil.rmtree(folder)
            total -= size


def _entries() -> list[tuple[float, Path, int]]:
    """When it was last used, folder, bytes of each entry; the longest unused first."""
    if not cache_folder().is_dir():
        return []
    folders = [child for child in cache_folder().iterdir() if child.is_dir() and not child.is_symlink()]
    return sorted((folder.stat().st_mtime, folder, sum(file.stat().st_size for file in folder.iterdir())) for folder in folders)


def _limit() -> int:
    path = cache_folder() / "limit.json"
    if not path.exists():
        return LIMIT
    try:
        return int(read_json(path, 1 << 16)["bytes"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DegenseError(f"{path} is damaged; set the limit again with degense cache --limit GB.") from error


def _smallest(index: np.ndarray) -> np.ndarray:
    """The same numbers in the smallest signed integers that hold them."""
    return index.astype(np.min_scalar_type(-max(int(index.max(initial=0)) + 1, 1)))
