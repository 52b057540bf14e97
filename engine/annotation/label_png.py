"""A label map as an indexed PNG in the colours of its classes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from degense.engine.annotation.edits import LabelClass
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.images import checked, picture_size, read_index
from degense.engine.data.files.numbered import shown
from degense.engine.errors import ClipError


def label_png(labels: np.ndarray, classes: Sequence[LabelClass]) -> bytes:
    """The bytes of a PNG file of a label map, uint8 [H, W]; unlabelled pixels look black."""
    palette = np.zeros((UNLABELLED + 1, 3), np.uint8)
    for index, kind in enumerate(classes):
        palette[index] = kind.colour
    image = Image.fromarray(labels).convert("L")
    image.putpalette(palette.tobytes())
    out = io.BytesIO()
    image.save(out, "PNG", compress_level=1)
    return out.getvalue()


def read_label_png(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """A label map uint8 [H, W] of that shape, from an indexed or grey PNG. ClipError otherwise; the size is checked before decoding."""
    size, found = (shape[1], shape[0]), picture_size(path)
    if found != size:
        raise ClipError(f"{shown(path)} is {found[0]} × {found[1]} pixels, but the frames are {size[0]} × {size[1]}; scale it first.")
    return checked(read_index(path), path, size)
