"""Arrays in .npy and .npz files of unknown origin: no pickle, and shape and type are known before anything is allocated.

`gt.npz` holds the exact answers of a synthetic clip.
"""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import IO

import numpy as np

from degense.engine.clip import Truth
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError
from degense.engine.untrusted import check_regular

_BROKEN = (OSError, ValueError, EOFError, SyntaxError, OverflowError, MemoryError, KeyError, NotImplementedError, RuntimeError)
#: Bytes of an array's file and of a header, and how much deflate can shrink.
MOST_BYTES, MOST_HEADER, MOST_RATIO = 64 << 30, 4096, 1040
_BROKEN_ZIP = (*_BROKEN, zipfile.BadZipFile, zipfile.LargeZipFile, zlib.error)


def open_npy(path: Path) -> np.ndarray:
    """A .npy file, mapped, not read. ClipError when it is damaged, cut short, holds objects, or anything but real numbers."""
    try:
        check_regular(path, MOST_BYTES)
        with path.open("rb") as file:
            _header(file)
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except _BROKEN as error:
        raise ClipError(f"{shown(path)} is not a sound .npy file of numbers (damaged, cut short or pickled).") from error
    if not isinstance(array, np.ndarray):
        array.close()
        raise ClipError(f"{shown(path)} is an .npz archive with the ending .npy; save it as .npy.")
    if array.dtype.kind not in "fiub":
        raise ClipError(f"{shown(path)} holds {array.dtype} values, but real numbers are needed.")
    return array


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether columns come first, and type. ValueError, among others, for a damaged header, or one of more than 4 KiB."""
    start = file.read(MOST_HEADER)
    begun = io.BytesIO(start)
    version = np.lib.format.read_magic(begun)
    length = int.from_bytes(start[8 : 10 if version == (1, 0) else 12], "little")
    if length > MOST_HEADER - 12:
        raise ValueError("a header that is too long")
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    try:
        shape, columns_first, dtype = read(begun)
    except tokenize.TokenError as error:
        raise ValueError("a header that is none") from error
    file.seek(begun.tell())
    if any(side < 0 for side in shape):
        raise ValueError("an array of no size")
    return shape, columns_first, dtype


def npz_headers(path: Path) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
    """Shape and type of each array of a .npz archive, read from the headers alone. ClipError for a damaged file."""
    headers = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for name in archive.namelist():
                if name.endswith(".npy"):
                    with archive.open(name) as file:
                        shape, _, dtype = _header(file)
                        headers[name[:-4]] = shape, dtype
    except _BROKEN_ZIP as error:
        raise ClipError(f"{shown(path)} is not a sound .npz archive (damaged or cut short).") from error
    return headers


def read_npz(path: Path, name: str) -> np.ndarray:
    """One array of a .npz archive whose header was found acceptable. ClipError for a damaged file, before memory is taken."""
    try:
        with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as file:
            shape, columns_first, dtype = _header(file)
            size, about = math.prod(shape) * dtype.itemsize, archive.getinfo(f"{name}.npy")
            if dtype.hasobject or size > about.file_size or about.file_size > MOST_RATIO * (about.compress_size + 1024):
                raise ValueError("more numbers than bytes")
            data = file.read(size)
            if len(data) < size:
                raise ValueError("fewer numbers than announced")
            return np.frombuffer(data, dtype).reshape(shape, order="F" if columns_first else "C")
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
