"""How an index writes a column: as one blob, whose number tells the run, the things and the kind, so that no second table finds it.

The columns of a run lie together, those of a thing side by side, and a run that is added is written at the end of the file.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from degense.engine.archive.frame_facts import PERCENTILES, Key
from degense.engine.archive.names import Things

#: Type and further axes of a column's values in memory.
FORMATS: dict[str, tuple[str, tuple[int, ...]]] = {
    "counts": ("<u2", ()),
    "pixels": ("<u4", ()),
    "sizes": ("<u4", ()),
    "middle": ("<f4", (2,)),
    "centres": ("<f4", (2,)),
    "overlap": ("<u4", ()),
    **dict.fromkeys(("touching", "near", "inside", "between"), ("?", ())),
    "confidence": ("<f2", ()),
    "displacement": ("<f4", (len(PERCENTILES),)),
}
OF_FRAMES = ("counts", "pixels", "middle", "confidence", "displacement", "overlap")
#: A number is, from its highest bits: the run, the thing, the first and the second other thing (from 1 in the order of `Things.names`; 0
#: for none), and the kind in the order of `FORMATS`.
THING_BITS, KIND_BITS = 8, 4
RUN_BITS = 3 * THING_BITS + KIND_BITS
MOST_NAMES, MOST_RUN_ID = (1 << THING_BITS) - 1, (1 << (63 - RUN_BITS)) - 1
_KINDS = {kind: number for number, kind in enumerate(FORMATS)}


def column_numbers(runs: Iterable[int], things: Things, keys: Iterable[Key]) -> list[int]:
    """Where columns of runs are written: all of the first run, all of the second, …"""
    places = {"": 0} | {name: place for place, name in enumerate(things.names, 1)}
    of_run = []
    for kind, *names in keys:
        one, two, three = (places[name] for name in (*names, "", "")[:3])
        of_run.append(((one << THING_BITS | two) << THING_BITS | three) << KIND_BITS | _KINDS[kind])
    return [run << RUN_BITS | number for run in runs for number in of_run]


def packed(key: Key, values: np.ndarray) -> bytes:
    """The bytes of a column: booleans as bits, whole numbers as narrow as the largest allows."""
    scalar = np.dtype(FORMATS[key[0]][0])
    if scalar.kind == "b":
        return np.packbits(values).tobytes()
    if scalar.kind == "u":
        largest = int(values.max(initial=0))
        scalar = np.dtype("<u1" if largest < 1 << 8 else "<u2" if largest < 1 << 16 else "<u4")
    return np.ascontiguousarray(values, scalar).tobytes()


def unpacked(kind: str, data: bytes, length: int) -> np.ndarray:
    """A column of so many rows; whole numbers as they were written. ValueError where the bytes are not that many."""
    scalar, axes = FORMATS[kind]
    of_row = np.dtype(scalar).itemsize * int(np.prod(axes, dtype=int))
    if length and scalar[1:2] == "u" and len(data) in (length, 2 * length, 4 * length):
        of_row = len(data) // length
        scalar = f"<u{of_row}"
    if len(data) != ((length + 7) // 8 if scalar == "?" else length * of_row):
        raise ValueError(f"{len(data)} bytes are no {length} rows of a column")
    if scalar == "?":
        return np.unpackbits(np.frombuffer(data, np.uint8), count=length).view(bool)
    return np.frombuffer(data, scalar).reshape(length, *axes)
