"""Exact answers beside a synthetic clip: `gt.npz`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from degense.engine.clip import Truth
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.numpy_header import npz_headers, read_npz
from degense.engine.errors import ClipError


class TruthFile:
    """`gt.npz` of a clip; its headers are checked at once, its arrays are read when asked for.

    Raises
    ------
    ClipError
        When an array is missing or has the wrong shape or type.
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

    def read(self) -> Truth:
        """The arrays.

        Raises
        ------
        ClipError
        """
        displacement = np.asarray(read_npz(self.path, "displacement"), np.float32)
        return Truth(displacement, read_npz(self.path, "cautery"))
