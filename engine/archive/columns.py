"""The columns of several runs with the same things, end to end: one long clip, whose frames are numbered through."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from degense.engine.archive.frame_facts import Key, Kind
from degense.engine.archive.index_file import IndexedRun, IndexFile
from degense.engine.archive.layout import FORMATS, OF_FRAMES
from degense.engine.errors import DegenseError


class Columns:
    """Read when they are first asked for, and kept. F frames in all, N objects of a thing."""

    def __init__(self, index: IndexFile, runs: Sequence[IndexedRun]) -> None:
        self.index, self.runs, self.things = index, tuple(runs), runs[0].things
        self.lengths = {run.id: run.frames for run in self.runs}
        self.starts = np.concatenate([[0], np.cumsum([run.frames for run in self.runs])])  # [runs + 1]
        self.frames = int(self.starts[-1])
        self._read: dict[Key, np.ndarray | None] = {}
        self._objects: dict[str, dict[int, int]] = {}
        self._frame_of: dict[str, np.ndarray] = {}

    def pixels(self, thing: str) -> np.ndarray:
        """Size of its mask in each frame, [F]."""
        found = self._column("pixels", thing)
        return np.zeros(self.frames, np.uint32) if found is None else found

    def middle(self, thing: str) -> np.ndarray:
        """Of its mask in each frame, [F, 2], pixels; 0 where there is none."""
        found = self._column("middle", thing)
        return np.zeros((self.frames, 2), np.float32) if found is None else found

    def overlap(self, one: str, other: str) -> np.ndarray | None:
        """Pixels that both masks hold in each frame, [F]; None where that is none anywhere."""
        return self._column("overlap", *sorted((one, other)))

    def sizes(self, thing: str) -> np.ndarray:
        """Pixels of each object, [N]."""
        found = self._column("sizes", thing)
        return np.zeros(0, np.uint32) if found is None else found

    def centres(self, thing: str) -> np.ndarray:
        """[N, 2], pixels."""
        found = self._column("centres", thing)
        return np.zeros((0, 2), np.float32) if found is None else found

    def holds(self, relation: Kind, thing: str, *to: str) -> np.ndarray:
        """Whether each object stands in a relation, bool [N]."""
        found = self._column(relation, thing, *to)
        return np.zeros(len(self.sizes(thing)), bool) if found is None else found

    def frame_of(self, thing: str) -> np.ndarray:
        """The frame of each object, int [N]; it never falls."""
        if thing not in self._frame_of:
            counts = self._column("counts", thing)
            self._frame_of[thing] = np.zeros(0, np.int64) if counts is None else np.repeat(np.arange(self.frames), counts)
        return self._frame_of[thing]

    def _column(self, *key: str) -> np.ndarray | None:
        if key not in self._read:
            kind, thing = key[:2]
            lengths = self.lengths if kind in OF_FRAMES else self._count(thing)
            found = self.index.columns(self.things, key, lengths)
            self._read[key] = self._joined(kind, found, lengths) if found else None
        return self._read[key]

    def _joined(self, kind: str, found: dict[int, np.ndarray], lengths: dict[int, int]) -> np.ndarray:
        scalar, axes = FORMATS[kind]
        whole, end = np.zeros((sum(lengths.values()), *axes), scalar), 0
        for run, length in lengths.items():
            begin, end = end, end + length
            if run in found:
                whole[begin:end] = found[run]
        return whole

    def _count(self, thing: str) -> dict[int, int]:
        """How many objects of a thing each run has."""
        if thing not in self._objects:
            counts = self._column("counts", thing)
            total = np.zeros(self.frames + 1, np.int64)
            if counts is not None:
                np.cumsum(counts, out=total[1:])
            of_runs = np.diff(total[self.starts])
            if (of_runs > 64 * (np.diff(self.starts) + 1_000)).any():
                raise DegenseError(f"{self.index.path} is damaged; delete it, and it is made again.")
            self._objects[thing] = {run.id: int(count) for run, count in zip(self.runs, of_runs, strict=True)}
        return self._objects[thing]
