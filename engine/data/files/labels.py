"""Label maps beside a clip: `labels/STEM.png` (8-bit indices) and `classes.json`; `strokes/STEM.png` are sparse ones; colour masks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from degense.engine.clip import UNLABELLED
from degense.engine.data.files.images import check_sizes, checked, read_index, read_rgb
from degense.engine.data.files.numbered import list_files, read_json, regular_file, shown
from degense.engine.errors import ClipError


class LabelMaps(Protocol):
    """Where a clip's label maps come from."""

    files: dict[int, Path]

    def read(self, index: int) -> np.ndarray:
        """uint8 [H, W] of a frame that is a key of `files`."""


class IndexMaps:
    """Label maps whose values index the classes."""

    def __init__(self, files: dict[int, Path], classes: tuple[str, ...], size: tuple[int, int]):
        self.files, self.classes, self.size = files, classes, size

    def read(self, index: int) -> np.ndarray:
        """uint8 [H, W]. ClipError for a value that is neither a class nor `UNLABELLED`."""
        path = self.files[index]
        labels = checked(read_index(path), path, self.size)
        beyond = labels[(labels >= len(self.classes)) & (labels != UNLABELLED)]
        if beyond.size:
            raise ClipError(
                f"{shown(path)} has the label value {int(beyond.max())}, but classes.json names only {len(self.classes)} classes."
            )
        return labels


def read_classes(path: Path) -> tuple[str, ...]:
    """The names in `classes.json`, `{"classes": ["background", …]}`. ClipError otherwise."""
    data = read_json(path)
    names = data.get("classes") if isinstance(data, dict) else None
    if not isinstance(names, list) or not all(isinstance(n, str) and n.strip() for n in names):
        raise ClipError(f'{shown(path)} must look like {{"classes": ["background", "liver"]}}.')
    if not 1 <= len(names) <= UNLABELLED:
        raise ClipError(f"{shown(path)} names {len(names)} classes, but there must be 1 to {UNLABELLED}.")
    if len(set(names)) != len(names):
        raise ClipError(f"{shown(path)} names a class twice.")
    return tuple(names)


def index_maps(
    root: Path, frames: Sequence[Path], size: tuple[int, int], folder: str = "labels", classes: tuple[str, ...] = ()
) -> IndexMaps | None:
    """The label maps in a folder of a clip, None when it has none. A few maps are read at once, so that a wrong one is noticed on opening.

    ClipError when they do not fit the frames. A map is named like its frame, of size (width, height), and lies in the folder "labels" or
    "strokes". Where the layout has no `classes`, `classes.json` names them.
    """
    files = list_files(root / folder, root, (".png",))
    if not files:
        return None
    if not classes:
        if not (root / "classes.json").exists():
            raise ClipError(f"{shown(root)} has {folder}/ but no classes.json that names their values; add one.")
        classes = read_classes(regular_file(root / "classes.json", root))
    maps = IndexMaps(by_frame(files, frames, size), classes, size)
    for i in sorted(maps.files)[:: max(1, len(maps.files) // 4)]:
        maps.read(i)
    return maps


def by_frame(files: Sequence[Path], frames: Sequence[Path], size: tuple[int, int]) -> dict[int, Path]:
    """Label files by the index of the frame that they are named like. ClipError for one of another name or size."""
    index = {frame.stem: i for i, frame in enumerate(frames)}
    for file in files:
        if file.stem not in index:
            where = f" in {frames[0].parent.name}/" if frames[0].parent.name else ""
            raise ClipError(f"{shown(file)} belongs to no frame{where}; it must be named like one, for example {frames[0].stem}.png.")
    if files:
        check_sizes(files, size)
    return {index[file.stem]: file for file in files}


def _packed(rgb: np.ndarray) -> np.ndarray:
    """Colours as one number a pixel, int64 [...]."""
    return (rgb[..., 0].astype(np.int64) << 16) | (rgb[..., 1].astype(np.int64) << 8) | rgb[..., 2]


class ColourCodes:
    """The colours (red, green, blue) of the classes 0, 1, …; no two alike."""

    def __init__(self, colours: Iterable[tuple[int, int, int]]):
        codes = _packed(np.array(list(colours)))
        self._order = np.argsort(codes)
        self._sorted = codes[self._order]

    def labels(self, mask: np.ndarray) -> np.ndarray:
        """Label map uint8 [H, W] of a colour mask uint8 [H, W, 3]; unknown colours → `UNLABELLED`."""
        codes = _packed(mask)
        place = np.minimum(np.searchsorted(self._sorted, codes), len(self._order) - 1)
        return np.where(self._sorted[place] == codes, self._order[place], UNLABELLED).astype(np.uint8)


class ColourMaps:
    """Label maps stored as colour masks, one a frame."""

    def __init__(self, files: dict[int, Path], codes: ColourCodes, size: tuple[int, int]):
        self.files, self.codes, self.size = files, codes, size

    def read(self, index: int) -> np.ndarray:
        """uint8 [H, W]; `UNLABELLED` where a colour is not in the table. ClipError for a damaged file."""
        path = self.files[index]
        return self.codes.labels(checked(read_rgb(path), path, self.size))
