"""The clip that all readers make: frames from somewhere, and whatever else lies beside them; its description and its fingerprint."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from degense.engine.clip import UNLABELLED, Clip, Truth, held_out
from degense.engine.data.files.cameras import ClipCameras
from degense.engine.data.files.depth import DepthFiles, DepthPrior
from degense.engine.data.files.images import ImageFiles
from degense.engine.data.files.labels import IndexMaps, LabelMaps
from degense.engine.data.files.masks import MaskFiles
from degense.engine.data.files.numpy_files import TruthFile
from degense.engine.latest import Latest

CACHE_BYTES = 256 << 20


class Pictures(Protocol):
    """Where a clip's frames come from: files that hold one each, or one for all; their size is (width, height)."""

    files: list[Path]
    size: tuple[int, int]

    def __len__(self) -> int: ...

    def read(self, index: int) -> np.ndarray:
        """RGB, uint8 [H, W, 3]."""


@dataclass(kw_only=True)
class StoredClip(Clip):
    """A clip on disk. Frames, validity and depth are read when asked for; the ones used last stay in memory, up to 256 MB together.

    Copies are given out.

    `inside`, bool [H, W], is the optical field of view.
    """

    pictures: Pictures
    inside: np.ndarray
    distances: DepthFiles | DepthPrior
    masks: MaskFiles | None = None
    label_maps: LabelMaps | None = None
    stroke_maps: LabelMaps | None = None
    truth_file: TruthFile | None = None
    cache: Latest = field(default_factory=lambda: Latest(CACHE_BYTES), repr=False)

    def frame(self, index: int) -> np.ndarray:
        i = self._checked(index)
        return self._cached("frame", i, lambda: self.pictures.read(i))

    def valid(self, index: int) -> np.ndarray:
        i = self._checked(index)
        if self.masks is None:
            return self.inside.copy()
        masks = self.masks
        return self._cached("valid", i, lambda: masks.keep(i) & self.inside)

    def depth(self, index: int) -> np.ndarray:
        i = self._checked(index)
        distances = self.distances
        if isinstance(distances, DepthFiles):
            return self._cached("depth", i, lambda: distances.read(i))
        return self._cached("depth", i, lambda: distances.depth(self.frame(i), self.valid(i), self.inside))

    @property
    def depth_measured(self) -> bool:
        return isinstance(self.distances, DepthFiles)

    @property
    def labelled_frames(self) -> list[int]:
        return sorted(self.label_maps.files) if self.label_maps else []

    def labels(self, index: int) -> np.ndarray | None:
        i = self._checked(index)
        maps = self.label_maps
        return self._cached("labels", i, lambda: maps.read(i)) if maps and i in maps.files else None

    @property
    def stroked_frames(self) -> list[int]:
        return sorted(self.stroke_maps.files) if self.stroke_maps else []

    def strokes(self, index: int) -> np.ndarray | None:
        i = self._checked(index)
        return self.stroke_maps.read(i) if self.stroke_maps and i in self.stroke_maps.files else None

    def truth(self) -> Truth | None:
        return self.truth_file.read() if self.truth_file else None

    def _cached(self, kind: str, index: int, load: Callable[[], np.ndarray]) -> np.ndarray:
        return self.cache.get((kind, index), load, lambda array: array.nbytes).copy()

    def _checked(self, index: int) -> int:
        if not 0 <= index < len(self):
            raise IndexError(f"frame {index} of a clip of {len(self)}")
        return int(index)


def clip_with_prior(
    path: Path,
    pictures: Pictures,
    some: Sequence[np.ndarray],
    field: np.ndarray | None,
    found: ClipCameras,
    words: dict[str, str],
    **others: Any,
) -> StoredClip:
    """A clip without depth files: its depth is a prior, from some of its frames.

    `field`, bool [H, W], is the field of view, None the whole frame; `words` are the provenance of all but depth and cameras; `others` are
    further attributes of `StoredClip`.
    """
    inside = np.ones(pictures.size[::-1], bool) if field is None else field
    prior = DepthPrior(some, [inside] * len(some), found.cameras[0])
    provenance = {**words, "depth": prior.words, **found.provenance}
    about = {"name": path.name, "path": path, "cameras": found.cameras, "poses": found.poses, "provenance": provenance}
    return StoredClip(**{**about, "pictures": pictures, "inside": inside, "distances": prior, **others})


def sampled(count: int, most: int = 8) -> list[int]:
    """Up to `most` frame indices spread over a clip, first and last among them."""
    return sorted({int(i) for i in np.linspace(0, count - 1, min(most, count)).round()})


def looked_at(count: int, most: int = 8) -> list[int]:
    """Up to `most` frames that are trained on, spread over a clip: all that the reader of a clip of `count` frames looks at.

    From them it tells the field of view, what masks mean, and a prior of depth, so held-out frames have no part in these.
    """
    trained_on = sorted(set(range(count)) - set(held_out(count)))
    return [trained_on[i] for i in sampled(len(trained_on), most)]


def map_words(maps: IndexMaps | None, count: int, folder: str) -> dict[str, str]:
    """Provenance of the label maps or strokes in a folder of a clip of `count` frames; strokes are mentioned when there are some."""
    if maps is None:
        return {} if folder == "strokes" else {folder: "none"}
    return {folder: f"{len(maps.files)} of {count} frames, {len(maps.classes)} classes, from {folder}/"}


def colour_map_words(maps: LabelMaps, count: int, source: str, gap: str) -> str:
    """`provenance["labels"]` of colour or grey masks; `gap` tells what unlabelled pixels lack."""
    if not maps.files:
        return "none"
    keys = sorted(maps.files)
    unknown = float(np.mean([(maps.read(keys[i]) == UNLABELLED).mean() for i in sampled(len(keys))]))
    words = f"{len(keys)} of {count} frames, {source}"
    return words + (f"; {100 * unknown:.1f} % of the pixels {gap} and are unlabelled" if unknown else "")


def counted(files: Sequence[Path], size: tuple[int, int]) -> str:
    """`provenance["frames"]` of a folder of pictures."""
    return f"{len(files)} pictures of {size[0]} × {size[1]}, {files[0].name} to {files[-1].name}"


DESCRIBED = ("frames", "poses", "focal", "masks", "depth", "labels", "strokes")
PIECE = 2**20


def describe(clip: Clip) -> str:
    """The lines a user sees: name, length and size, then where each thing comes from."""
    width, height = clip.size
    lines = [f"{clip.name}: {len(clip)} frames, {width} × {height}"]
    lines += [f"  {key:<7} {clip.provenance[key]}" for key in DESCRIBED if key in clip.provenance]
    if clip.classes:
        lines.append(f"  classes {', '.join(clip.classes)}")
    return "\n".join(lines)


def frame_names(clip: Clip) -> tuple[str, ...]:
    """What label files of the frames are called: the stems of the pictures, numbers where the frames are no files of their own."""
    if isinstance(clip, StoredClip) and isinstance(clip.pictures, ImageFiles):
        return tuple(file.stem for file in clip.pictures.files)
    return tuple(f"{index:06d}" for index in range(len(clip)))


def fingerprint(clip: Clip) -> str:
    """A name for a clip's frames that survives moving the folder: sha256, 64 hexadecimal digits.

    It covers the number and size of the frames, the names and byte sizes of their files, and the bytes of a few of them (of a large file:
    a piece at its start, middle and end). Masks, depth and labels are not covered: adding a label map leaves the clip the same.
    A clip that lies in no files is told by the pixels of a few frames.
    """
    digest = hashlib.sha256(f"{len(clip)} {clip.size[0]}x{clip.size[1]}\n".encode())
    if not isinstance(clip, StoredClip):
        for i in sampled(len(clip), 4):
            digest.update(clip.frame(i).tobytes())
        return digest.hexdigest()
    files = clip.pictures.files
    for file in files:
        digest.update(f"{file.name}\0{file.stat().st_size}\n".encode("utf-8", "surrogateescape"))
    for i in sampled(len(files), 4):
        _add_pieces(files[i], digest)
    return digest.hexdigest()


def _add_pieces(path: Path, digest: hashlib._Hash) -> None:
    size = path.stat().st_size
    with path.open("rb") as file:
        for offset in (0,) if size <= 3 * PIECE else (0, size // 2, size - PIECE):
            file.seek(offset)
            digest.update(file.read(3 * PIECE if size <= 3 * PIECE else PIECE))
