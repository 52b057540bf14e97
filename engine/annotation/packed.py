"""Label maps in a few kilobytes: what undo, the journal and frames that nobody looks at keep."""

from __future__ import annotations

import zlib

import numpy as np


def pack(labels: np.ndarray) -> bytes:
    """uint8 [H, W], compressed; regions of one value cost next to nothing."""
    return zlib.compress(np.ascontiguousarray(labels, np.uint8).tobytes(), 1)


def unpack(packed: bytes, shape: tuple[int, int]) -> np.ndarray:
    """What `pack` was given, uint8 [H, W], writable. ValueError when the bytes are not a map of this shape; never more is allocated."""
    height, width = shape
    decompressor = zlib.decompressobj()
    try:
        data = decompressor.decompress(packed, height * width + 1)
    except zlib.error as error:
        raise ValueError(f"not a packed label map ({error})") from error
    if len(data) != height * width:
        raise ValueError(f"a packed label map of {len(data)} bytes or more, but {width} × {height} pixels were expected")
    return np.frombuffer(bytearray(data), np.uint8).reshape(height, width)
