"""What every teacher offers, targets of a soft label map (every place a mixture of its two likeliest classes), and the teacher `labels`."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.errors import ClipError
from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.text.encoder import TextEncoder

#: Unit vectors float32 [k, D], and int32 [H, W] that says which of them a pixel should have; −1 where there is no target.
Targets = tuple[np.ndarray, np.ndarray]
LEVELS = 8  # steps of a mixture of two classes, from half and half to the first class alone


class Described(Protocol):
    """What is known of a teacher."""

    name: str  # "labels", …
    provenance: str  # for the user: where the targets come from and on which frames
    frames: list[int]  # that have targets, ascending; never a held-out frame, unless the clip has no other
    encoder: TextEncoder  # turns prompts into vectors that compare with the targets; the run keeps it
    pixelwise: bool  # each pixel has its vector; else a vector describes the area of its pixels as a whole, as a coarse feature map does


class Teacher(Described, Protocol):
    """A source of unit feature vectors per pixel."""

    def targets(self, frame: int) -> Targets | None:
        """Vectors and index map of a frame, or None when it has no targets."""
        ...


def enlarged(cells: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A map [h, w] at (width, height): the cell that each pixel lies in."""
    (rows, columns), (width, height) = cells.shape, size
    y, x = (np.arange(height) + 0.5) * rows / height, (np.arange(width) + 0.5) * columns / width
    return cells[y.astype(int)[:, None], x.astype(int)]


def soft_targets(probabilities: np.ndarray, vectors: np.ndarray, known: np.ndarray) -> Targets:
    """Targets of a soft label map float [..., k], of which only proportions count, where it is `known`, bool [...].

    Of the classes' unit vectors [k, D] only mixtures that occur, float32 [m, D]: p · v_first + (1 − p) · v_second, of unit length, with p
    rounded to `LEVELS` steps.
    """
    count = len(vectors)
    if count == 1:
        return vectors, np.where(known, 0, -1).astype(np.int32)
    order = np.argpartition(probabilities, count - 2, axis=-1)[..., -2:]
    pair = np.take_along_axis(probabilities, order, -1)
    swap = pair[..., 0] > pair[..., 1]
    first, second = np.where(swap, order[..., 0], order[..., 1]), np.where(swap, order[..., 1], order[..., 0])
    share = pair.max(-1) / np.maximum(pair.sum(-1), 1e-12)
    level = np.clip(np.round((2 * share - 1) * LEVELS), 0, LEVELS).astype(np.int64)
    second = np.where(level == LEVELS, first, second)
    codes, places = np.unique(((first * count + second) * (LEVELS + 1) + level)[known], return_inverse=True)
    a, b, p = codes // (LEVELS + 1) // count, codes // (LEVELS + 1) % count, 0.5 + codes % (LEVELS + 1) / (2 * LEVELS)
    mixed = p[:, None] * vectors[a] + (1 - p)[:, None] * vectors[b]
    index = np.full(known.shape, -1, np.int32)
    index[known] = places
    return unit_rows(mixed).astype(np.float32), index


class LabelTeacher:
    """Targets from the label maps beside a clip.

    Label maps of held-out frames are never used, except that a clip with a single label map trains on that one wherever it lies.
    "background" is a class like any other: a black border that an annotator labelled carries the background's own vector,
    so that "background" can be prompted and competes in argmax. Pixels outside `clip.valid` and unlabelled pixels carry nothing.
    `encoder` is extended with the clip's class names: `self.encoder` is the one to keep with the run. ClipError if the clip has no label
    maps, or only on held-out frames.
    """

    name = "labels"
    pixelwise = True

    def __init__(self, clip: Clip, encoder: TextEncoder):
        labelled = clip.labelled_frames
        if not labelled:
            raise ClipError(f"Clip '{clip.name}' has no label maps; add labels/ and classes.json, or train without a teacher.")
        held_out = set(clip.test_frames)
        self.frames = labelled if len(labelled) == 1 else [frame for frame in labelled if frame not in held_out]
        if not self.frames:
            raise ClipError(
                f"All label maps of clip '{clip.name}' ({len(labelled)}) lie on held-out frames (1, 9, 17, …); label another frame."
            )
        self.encoder = encoder.with_classes(clip.classes)
        self.vectors = self.encoder.encode(clip.classes)
        self._clip = clip
        source = clip.provenance.get("labels", "label maps")
        used = f"{len(self.frames)} of {len(labelled)} label maps, {len(clip.classes)} classes"
        self.provenance = f"{source}: {used}, encoder {self.encoder.name}"

    def targets(self, frame: int) -> Targets | None:
        """The vectors of all classes float32 [k, D], and the index map int32 [H, W]; None for frames without a label map to learn from.

        ClipError if the label map holds a value that `classes` does not name.
        """
        if frame not in self.frames:
            return None
        labels = self._clip.labels(frame)
        if labels is None:
            return None
        index = labels.astype(np.int32)
        index[(labels == UNLABELLED) | ~self._clip.valid(frame)] = -1
        if index.max(initial=-1) >= len(self.vectors):
            found = f"holds value {index.max()}, but there are {len(self.vectors)} classes"
            raise ClipError(f"The label map of frame {frame} of clip '{self._clip.name}' {found}; correct it or classes.json.")
        return self.vectors, index
