"""Reading pictures of unknown origin: the header is checked before a pixel is decoded, and a damaged file is an error, not a grey area.

Pillow reads them: it refuses files that are cut short (OpenCV fills the rest with grey) and keeps the indices of palette pictures.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from PIL import Image

from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError
from degense.engine.progress import check_reading

MAX_PIXELS = 64_000_000
FORMATS = ("PNG", "JPEG", "BMP", "TIFF", "WEBP")
_BROKEN = (OSError, ValueError, SyntaxError, EOFError, OverflowError, LookupError, TypeError, AttributeError, struct.error, zlib.error)


class _File(io.BufferedReader):
    """A file that is never asked for more than it has: Python takes memory for what is asked, and a damaged chunk announces up to 4 GB."""

    def read(self, size: int | None = -1, /) -> bytes:
        left = max(0, os.fstat(self.fileno()).st_size - self.tell())
        return super().read(left if size is None or size < 0 else min(size, left))


@contextmanager
def _open(path: Path) -> Iterator[Image.Image]:
    check_reading()
    with ExitStack() as stack:
        try:
            image = Image.open(stack.enter_context(_File(io.FileIO(path))), formats=FORMATS)
        except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
            raise ClipError(f"{shown(path)} is larger than {MAX_PIXELS // 1_000_000} megapixels; scale it down first.") from error
        except _BROKEN as error:
            why = error.strerror.lower() if isinstance(error, OSError) and error.strerror else _what_is_wrong(path)
            raise ClipError(f"{shown(path)} is not a picture that can be read ({why}).") from error
        if image.width * image.height > MAX_PIXELS:
            size = f"{image.width} × {image.height}"
            raise ClipError(f"{shown(path)} is {size} pixels, more than {MAX_PIXELS // 1_000_000} megapixels; scale it down first.")
        yield image


def _what_is_wrong(path: Path) -> str:
    return "unknown or damaged" if path.stat().st_size else "empty"


def read_raw(path: Path) -> np.ndarray:
    """The picture as stored: [H, W] or [H, W, C], its own integer or float type; palette pictures give their indices.

    ClipError for a damaged file.
    """
    return _decoded(path, None)


def read_rgb(path: Path) -> np.ndarray:
    """RGB, uint8 [H, W, 3]. ClipError for a damaged file."""
    return _decoded(path, "RGB")


def _decoded(path: Path, mode: str | None) -> np.ndarray:
    with _open(path) as image:
        try:
            return np.array(image.convert(mode) if mode else image)
        except _BROKEN as error:
            raise ClipError(f"{shown(path)} is cut short or damaged; copy it again.") from error


def read_index(path: Path) -> np.ndarray:
    """One 8-bit channel, uint8 [H, W]: palette and grey pictures as they are, colour pictures whose channels agree as one of them.

    ClipError also when the channels differ: a colour picture says nothing about indices.
    """
    raw = read_raw(path)
    if raw.ndim == 3:
        if raw.shape[2] > 2 and (raw[..., 1:3] != raw[..., :1]).any():  # two channels are grey and alpha
            raise ClipError(f"{shown(path)} is a colour picture, but an 8-bit picture with one value a pixel is needed.")
        raw = raw[..., 0]
    if raw.dtype == bool:
        return raw.astype(np.uint8)
    if raw.dtype != np.uint8:
        raise ClipError(f"{shown(path)} has {raw.dtype} values, but an 8-bit picture is needed.")
    return np.ascontiguousarray(raw)


def picture_size(path: Path) -> tuple[int, int]:
    """(width, height) from the header. A file that does not end as its format does is decoded, to find out now and not amid training.

    ClipError for a damaged file.
    """
    with _open(path) as image:
        size, kind = image.size, image.format
    ending = {"PNG": b"IEND", "JPEG": b"\xff\xd9"}.get(kind or "")
    if ending is not None:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - 64))
            if ending not in file.read():
                read_raw(path)
    return size


def check_sizes(files: Iterable[Path], size: tuple[int, int] | None = None) -> tuple[int, int]:
    """The common (width, height) of pictures, which must be `size` when that is given. ClipError otherwise."""
    others = "the frames are"
    for file in files:
        found = picture_size(file)
        if size is None:
            size, others = found, f"{file.name} is"
        if found != size:
            told = f"{found[0]} × {found[1]}"
            raise ClipError(f"{shown(file)} is {told} pixels, but {others} {size[0]} × {size[1]}; all pictures of a clip need one size.")
    if size is None:
        raise ValueError("no files")
    return size


class ImageFiles:
    """Frames stored as one picture each, all of one size (width, height)."""

    def __init__(self, files: list[Path]):
        self.files = files
        self.size = check_sizes(files)

    def __len__(self) -> int:
        return len(self.files)

    def read(self, index: int) -> np.ndarray:
        """RGB, uint8 [H, W, 3]."""
        return checked(read_rgb(self.files[index]), self.files[index], self.size)


def checked(image: np.ndarray, path: Path, size: tuple[int, int]) -> np.ndarray:
    """`image`, which must still have the size found when the clip was opened. ClipError otherwise."""
    if image.shape[1::-1] != size:
        found = f"{image.shape[1]} × {image.shape[0]}"
        raise ClipError(
            f"{shown(path)} was changed since the clip was opened: it is {found} pixels, not {size[0]} × {size[1]}; open it again."
        )
    return image
