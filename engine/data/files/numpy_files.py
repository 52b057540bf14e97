"""Arrays in .npy and .npz files of unknown origin: no pickle, and shape and type are known before anything is allocated.

`gt.npz` holds the exact answers of a synthetic clip.
"""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import IO

import numpy as np

from degense.engine.clip import Truth
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError

_BROKEN = (OSError, ValueError, EOFError, SyntaxError, OverflowError, MemoryError, KeyError, NotImplementedError, RuntimeError)
_BROKEN_ZIP = (*_BROKEN, zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error)


def open_npy(path: Path) -> np.ndarray:
    """A .npy file, mapped, not read. ClipError when it is damaged, cut short, holds objects, or anything but real numbers."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except _BROKEN as error:
        raise ClipError(f"{shown(path)} is not a sound .npy file of numbers (damaged, cut short or pickled).") from error
    if not isinstance(array, np.ndarray):
        array.close()
        raise ClipError(f"{shown(path)} is an .npz archive with the ending .npy; save it as .npy.")
    if array.dtype.kind not in "fiub":
        raise ClipError(f"{shown(path)} holds {array.dtype} values, but real numbers are needed.")
    return array


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype]:
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    return shape, dtype


def npz_headers(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
    """Shape and type of each array of a .npz archive, read from the headers alone. ClipError for a damaged file."""
    headers = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                if name.endswith(".npy"):
                    with archive.open(name) as file:
                        headers[name[:-4]] = _header(file)
    except _BROKEN_ZIP as error:
        raise ClipError(f"{shown(path)} is not a sound .npz archive (damaged or cut short).") from error
    return headers


def read_npz(path: Path, name: str) -> np.ndarray:
    """One array of a .npz archive whose header was found acceptable. ClipError for a damaged file."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return archive[name]
    except _BROKEN_ZIP as error:
        raise ClipError(f"{shown(path)}: the array '{name}' is damaged or cut short.") from error


MOST_TRACKS = 100_000


class TruthFile:
    """`gt.npz` of a clip; its headers are checked at once, its arrays are read when asked for.

    ClipError when an array is missing or has the wrong shape or type.
    """

    def __init__(self, path: Path, count: int, size: tuple[int, int]):
        self.path = path
        headers = npz_headers(path)
        wanted = {"displacement": ((count, size[1], size[0], 3), "f"), "cautery": ((count, size[1], size[0]), "b")}
        for name, (shape, kind) in wanted.items():
            if name not in headers:
                raise ClipError(f"{shown(path)} has no array '{name}'.")
            found, dtype = headers[name]
            if found != shape or dtype.kind != kind:
                raise ClipError(
                    f"{shown(path)}: '{name}' is {dtype} {list(found)}, but must be {'float' if kind == 'f' else 'bool'} {list(shape)}."
                )

        self.tracked = "tracks" in headers and "visible" in headers
        if self.tracked:
            points = headers["tracks"][0][:1]
            kinds = headers["tracks"][1].kind, headers["visible"][1].kind
            shapes = headers["tracks"][0], headers["visible"][0]
            if kinds != ("f", "b") or shapes != ((*points, count, 3), (*points, count)) or points[0] > MOST_TRACKS:
                raise ClipError(f"{shown(path)}: 'tracks' and 'visible' must be float [K, {count}, 3] and bool [K, {count}].")

    def read(self) -> Truth:
        """The arrays. ClipError for a damaged file."""
        displacement = np.asarray(read_npz(self.path, "displacement"), np.float32)
        tracks = (np.asarray(read_npz(self.path, "tracks"), np.float32), read_npz(self.path, "visible")) if self.tracked else (None, None)
        return Truth(displacement, read_npz(self.path, "cautery"), *tracks)
