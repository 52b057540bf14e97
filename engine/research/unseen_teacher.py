"""A teacher of another kind than the degraded ones, on which nothing is chosen: blocks, errors that come and go, thin tools missed."""

from __future__ import annotations

import numpy as np

from degense.engine.clip import Clip
from degense.engine.errors import DegenseError
from degense.engine.research.degraded_teachers import without_thin
from degense.engine.semantics.teachers.teacher import LabelTeacher, Targets, enlarged
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.vocabulary import instruments

CELL = 16 / 640  # of the width: side of the blocks that it sees
BLOCK = 4  # cells along the side of a region that is mistaken as a whole
WRONG = 0.22  # share of the regions that are called by a name drawn at random
LASTS = 4  # frames that such a mistake lasts on average
MISSED, THIN = 0.3, 0.05  # share of the frames in which instruments thinner than this share of the width are missed


class UnseenTeacher:
    """A clip's label maps as "unseen", or "unseen:seed=N", answers: the commonest class of each cell, with mistakes that last.

    In each region one of two states holds, right and mistaken, and changes from frame to frame by chance (a Markov chain with `WRONG` of
    the frames mistaken, for `LASTS` frames on average). A mistaken region gives each class in it a name drawn anew for each mistake.
    DegenseError for another name, and as of `LabelTeacher`.
    """

    pixelwise = True

    def __init__(self, name: str, clip: Clip, encoder: TextEncoder):
        how = name.partition(":")[2]
        number = how.removeprefix("seed=") if how else "0"
        if not number.isdecimal():
            raise DegenseError(f"the unseen teacher does not understand {how!r}: say unseen:seed=0")
        self.labels, self._seed = LabelTeacher(clip, encoder), int(number)
        self.frames, self.encoder, self.name = self.labels.frames, self.labels.encoder, f"unseen:seed={self._seed}"
        self.provenance = f"{self.labels.provenance}; degraded on purpose (in blocks, seed {self._seed})"
        self._tools, self._length = instruments(clip.classes), len(clip)
        self._names: np.ndarray | None = None  # int [frames, regions down, regions across, classes]

    def targets(self, frame: int) -> Targets | None:
        """Vectors float32 [k, D] of the classes and the index map int32 [H, W]."""
        answer = self.labels.targets(frame)
        if answer is None:
            return None
        vectors, index = answer
        height, width = index.shape
        shape = max(1, round(1 / CELL * height / width)), round(1 / CELL)
        names = self._named(len(vectors), (-(-shape[0] // BLOCK), -(-shape[1] // BLOCK)))[frame]
        if np.random.default_rng([self._seed, 1, frame]).random() < MISSED:
            index = without_thin(index, self._tools, max(3, round(THIN * width)))
        cells = _commonest(index, shape, len(vectors))
        rows, columns = np.indices(shape) // BLOCK
        said = np.where(cells >= 0, names[rows, columns, cells], -1)
        return vectors, np.where(index >= 0, enlarged(said, (width, height)), -1).astype(np.int32)

    def _named(self, count: int, regions: tuple[int, int]) -> np.ndarray:
        """What each class is called in each region of each frame."""
        if self._names is None:
            rng = np.random.default_rng([self._seed, 0])
            mistaken, named = rng.random((*regions, 1)) < WRONG, rng.integers(0, count, (*regions, count))
            found = []
            for _ in range(self._length):
                found.append(np.where(mistaken, named, np.arange(count)))
                begins = ~mistaken & (rng.random(mistaken.shape) < WRONG / (1 - WRONG) / LASTS)
                ends = mistaken & (rng.random(mistaken.shape) < 1 / LASTS)
                named = np.where(begins, rng.integers(0, count, named.shape), named)
                mistaken = (mistaken | begins) & ~ends
            self._names = np.stack(found)
        return self._names


def _commonest(index: np.ndarray, shape: tuple[int, int], count: int) -> np.ndarray:
    """The commonest class of an index map int [H, W] in each cell of a grid, int [rows, columns]; −1 where nothing is labelled."""
    cell = enlarged(np.arange(shape[0] * shape[1]).reshape(shape), index.shape[::-1])
    known = index >= 0
    votes = np.bincount(cell[known] * count + index[known], minlength=shape[0] * shape[1] * count).reshape(*shape, count)
    return np.where(votes.any(-1), votes.argmax(-1), -1)
