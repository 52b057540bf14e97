"""Teachers that err as segmenters and vision-language models do, in known measure, so that one can see what a method makes of it.

Each of three models of error has three strengths. All begin with the clip's own label maps, which nothing else reads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import cv2
import numpy as np

from degense.engine.clip import Clip
from degense.engine.errors import DegenseError
from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.teachers.teacher import LabelTeacher, Targets
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.vocabulary import instruments

ErrorModel = Literal["features", "flips", "drift"]
CELLS = (6, 5)  # regions that can be mistaken as a whole: cells of this jittered grid, cut by the borders of the classes
EPISODE = 12  # frames that the confusion of a pair of classes in a region, and a knot of the boundary's drift, last

# Of strength 1, 2, 3:
PATCHES = (40, 24, 14)  # feature vectors along the longer side; 24 is a CLIP at 384 × 384 pixels
NOISE = (0.3, 0.5, 0.7)  # radians by which each vector is turned, in the mean of squares
FLIPPED = (0.1, 0.22, 0.35)  # share of the regions of a frame that are taken for another class
THIN = (0.015, 0.025, 0.04)  # of the width: parts of instruments that are thinner are missed
DRIFT = (0.01, 0.02, 0.035)  # of the width: standard deviation of the displacement of boundaries
CONFUSED = (0.05, 0.12, 0.22)  # share of the regions that are taken for the class most alike


@dataclass(frozen=True)
class Degradation:
    """What is done to the label maps.

    Attributes
    ----------
    model : {"features", "flips", "drift"}
        - "features": a feature vector for each patch of the frame, the mean over its patch and half of the patches around it, as receptive
          fields overlap, turned by noise.
        - "flips": in every frame anew, single regions called by some other class; thin parts of instruments are missed.
        - "drift": boundaries lie beside the true ones, by a displacement that is smooth in the frame and changes slowly, and regions are
          taken for the class most alike, for `EPISODE` frames.
    strength : int
        1, 2 or 3.
    seed : int
    """

    model: ErrorModel = "features"
    strength: int = 2
    seed: int = 0

    def __post_init__(self) -> None:
        if self.model not in get_args(ErrorModel):
            raise DegenseError(f"a teacher is not degraded by {self.model!r}: choose {', '.join(get_args(ErrorModel))}")
        if self.strength not in (1, 2, 3) or not 0 <= self.seed < 2**31:
            raise DegenseError("a teacher is degraded with a strength of 1, 2 or 3, and a seed that is not negative")

    def __str__(self) -> str:
        return f"model={self.model},strength={self.strength},seed={self.seed}"

    @classmethod
    def parse(cls, words: str) -> Degradation:
        """The inverse of `str`; what is not named keeps its default. DegenseError in one sentence."""
        given = dict(word.partition("=")[::2] for word in filter(None, words.split(",")))
        numbers = {name: given.pop(name) for name in ("strength", "seed") if name in given}
        if set(given) - {"model"} or not all(number.isdecimal() for number in numbers.values()):
            raise DegenseError(f"a degraded teacher does not understand {words!r}: say model=flips,strength=2,seed=0")
        return cls(**given, **{name: int(number) for name, number in numbers.items()})  # type: ignore[arg-type]


class DegradedTeacher:
    """A clip's label maps, degraded; the same seed and frame give the same answer. DegenseError as of `LabelTeacher`."""

    def __init__(self, clip: Clip, encoder: TextEncoder, degradation: Degradation = Degradation()):
        self.labels, self.degradation = LabelTeacher(clip, encoder), degradation
        self.frames, self.encoder = self.labels.frames, self.labels.encoder
        self.pixelwise = degradation.model != "features"
        self.name = f"degraded:{degradation}"
        self.provenance = f"{self.labels.provenance}; degraded on purpose ({degradation})"
        self._tools, self._twin = instruments(clip.classes), confusable(self.labels.vectors)

    def targets(self, frame: int) -> Targets | None:
        """Vectors float32 [k, D] of the classes, or with "features" of the patches, and the index map int32 [H, W]."""
        answer = self.labels.targets(frame)
        if answer is None:
            return None
        vectors, index = answer
        degrade: dict[str, Callable[[np.ndarray, np.ndarray, int], Targets]]
        degrade = {"features": self._features, "flips": self._flips, "drift": self._drift}
        return degrade[self.degradation.model](vectors, index, frame)

    def _features(self, vectors: np.ndarray, index: np.ndarray, frame: int) -> Targets:
        present = np.unique(index[index >= 0])
        if not len(present):
            return vectors, index
        shares, patch_of = _patches(index, present, self._of(PATCHES))
        mixed = unit_rows(shares @ vectors[present])
        return _turned(mixed, self._of(NOISE), self._random("frame", frame)), np.where(index >= 0, patch_of, -1).astype(np.int32)

    def _flips(self, vectors: np.ndarray, index: np.ndarray, frame: int) -> Targets:
        rng, count = self._random("frame", frame), len(vectors)
        width = max(3, round(self._of(THIN) * index.shape[1]))
        assigned = without_thin(index, self._tools, width)
        cells, source = _cells(index.shape, rng), assigned.copy()
        mistaken = rng.random((CELLS[0] * CELLS[1], count)) < self._of(FLIPPED)
        other = (np.arange(count) + rng.integers(1, max(count, 2), mistaken.shape)) % count
        known = source >= 0
        flipped = known & mistaken[cells, source]  # −1 looks up the last class, and is left out
        assigned[flipped] = other[cells[flipped], source[flipped]]
        return vectors, assigned

    def _drift(self, vectors: np.ndarray, index: np.ndarray, frame: int) -> Targets:
        height, width = index.shape
        way = self._of(DRIFT) * width * self._displacement(frame, (width, height))
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        moved = cv2.remap(index.astype(np.float32), x + way[..., 0], y + way[..., 1], cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        assigned = np.where((index >= 0) & (moved >= 0), moved, index).astype(np.int32)
        persistent = self._random("clip")
        cells, shape = _cells(index.shape, persistent), (CELLS[0] * CELLS[1], len(vectors))
        episodes = (frame + persistent.integers(0, EPISODE, shape)) // EPISODE  # those of different regions begin at different frames
        drawn = np.array([self._random("episode", number).random(shape) for number in range(episodes.max() + 1)])
        confused = np.take_along_axis(drawn, episodes[None], 0)[0] < self._of(CONFUSED)
        taken = (assigned >= 0) & confused[cells, assigned]
        return vectors, np.where(taken, self._twin[assigned], assigned).astype(np.int32)

    def _displacement(self, frame: int, size: tuple[int, int]) -> np.ndarray:
        """Smooth in the frame and from knot to knot in time, float32 [H, W, 2], of a standard deviation of about 1."""
        knot, share = divmod(frame / EPISODE, 1)
        angle = share * np.pi / 2  # keeps the variance between the knots
        one, two = (self._random("knot", int(knot) + step).standard_normal((5, 6, 2)) for step in (0, 1))
        return cv2.resize((np.cos(angle) * one + np.sin(angle) * two).astype(np.float32), size, interpolation=cv2.INTER_CUBIC)

    def _of(self, by_strength: tuple[float, float, float]) -> float:
        return by_strength[self.degradation.strength - 1]

    def _random(self, of: Literal["clip", "frame", "episode", "knot"], number: int = 0) -> np.random.Generator:
        """Chances of something, the same every time; other ones for every seed, model and strength."""
        how, purposes = self.degradation, ("clip", "frame", "episode", "knot")
        return np.random.default_rng([how.seed, get_args(ErrorModel).index(how.model), how.strength, purposes.index(of), number])


def degraded(name: str, clip: Clip, encoder: TextEncoder) -> DegradedTeacher:
    """The teacher "degraded", or with its errors named, "degraded:model=flips,strength=2,seed=0"."""
    return DegradedTeacher(clip, encoder, Degradation.parse(name.partition(":")[2]))


def confusable(vectors: np.ndarray) -> np.ndarray:
    """For each class the one whose vector is most alike, int [k]; of equally like ones the next in order."""
    alike = np.round(vectors.astype(np.float64) @ vectors.T, 3)
    np.fill_diagonal(alike, -np.inf)
    order = (np.arange(len(vectors))[None] - np.arange(len(vectors))[:, None] - 1) % len(vectors)
    return np.lexsort((order, -alike), axis=1)[:, 0] if len(vectors) > 1 else np.zeros(1, int)


def without_thin(index: np.ndarray, classes: list[int], width: int) -> np.ndarray:
    """An index map int [H, W] in which parts of some classes that are thinner than `width` pixels are called what lies beside them."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (width, width))
    inside = np.isin(index, classes)
    opened = cv2.morphologyEx(inside.astype(np.uint8), cv2.MORPH_OPEN, disc, borderType=cv2.BORDER_REPLICATE) > 0
    thin = inside & ~opened
    beside = (index >= 0) & ~inside
    if not thin.any() or not beside.any():
        return index.copy()
    _, nearest = cv2.distanceTransformWithLabels((~beside).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    of_pixel = np.zeros(nearest.max() + 1, index.dtype)
    of_pixel[nearest[beside]] = index[beside]
    return np.where(thin, of_pixel[nearest], index)


def _cells(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Cell of each pixel, int [H, W]: the nearest point of a jittered grid."""
    columns, rows = CELLS
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    points = (np.stack([x, y], -1).reshape(-1, 2) + rng.uniform(0.1, 0.9, (columns * rows, 2))) / CELLS * shape[::-1]
    px, py = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    return ((px[..., None] - points[:, 0]) ** 2 + (py[..., None] - points[:, 1]) ** 2).argmin(-1)


def _patches(index: np.ndarray, present: np.ndarray, along: float) -> tuple[np.ndarray, np.ndarray]:
    """Share of each labelled class in each patch's receptive field, float64 [k, n], and the patch of each pixel, int [H, W]."""
    height, width = index.shape
    side = max(height, width) / along
    columns, rows = max(1, round(width / side)), max(1, round(height / side))
    kernel = np.array([0.25, 0.5, 0.25])
    shares = []
    for value in present:
        area = cv2.resize((index == value).astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
        shares.append(cv2.sepFilter2D(area, cv2.CV_64F, kernel, kernel, borderType=cv2.BORDER_REFLECT))
    x, y = np.arange(width) * columns // width, np.arange(height) * rows // height
    return np.stack(shares, -1).reshape(-1, len(present)), y[:, None] * columns + x


def _turned(vectors: np.ndarray, angle: float, rng: np.random.Generator) -> np.ndarray:
    """Unit vectors [k, D], each turned by an angle drawn from N(0, angle²) in a random direction, float32."""
    way = rng.standard_normal(vectors.shape)
    way = unit_rows(way - (way * vectors).sum(1, keepdims=True) * vectors)
    by = rng.normal(0, angle, (len(vectors), 1))
    return (np.cos(by) * vectors + np.sin(by) * way).astype(np.float32)
