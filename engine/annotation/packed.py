"""Label maps in a few kilobytes: what undo, the journal and proposals hold."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

#: Confidence below which a proposal is listed for review.
DOUBTFUL = 0.75


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


@dataclass(frozen=True)
class Proposal:
    """A label map propagated from other frames, (height, width) = `shape`.

    `confidence`, in [0, 1], is the expected intersection over union, averaged over the classes in the map.
    """

    packed: bytes
    shape: tuple[int, int]
    confidence: float

    @property
    def labels(self) -> np.ndarray:
        """uint8 [H, W]."""
        return unpack(self.packed, self.shape)

    @property
    def doubtful(self) -> bool:
        return self.confidence < DOUBTFUL
