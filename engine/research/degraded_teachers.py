"""A teacher made as unreliable as a vision-language model, in known measure, so that one can see what a method makes of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import cv2
import numpy as np

from degense.engine.clip import Clip
from degense.engine.errors import DegenseError
from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.teachers.teacher import LabelTeacher, Targets, Teacher
from degense.engine.semantics.text.encoder import TextEncoder

CELLS = (6, 5)  # regions that can be mistaken as a whole: cells of this jittered grid, cut by the borders of the classes
EPISODE = 5  # frames that a mistaken region stays so


@dataclass(frozen=True)
class Degradation:
    """What is done to a teacher's answers; 0 leaves them as they are.

    Attributes
    ----------
    patches : int
        Feature vectors along the longer side of a frame. Each is the mean over its patch and half of the patches around it, as
        overlapping receptive fields blur.
    noise : float
        Standard deviation of the angle, radians, by which every vector is turned, each into a random direction.
    confusion : float
        Every class leans by this weight towards the one it is most alike, v ← (1 − w)·v + w·v', and this share of the regions is taken
        for that class altogether, for `EPISODE` frames.
    flicker : float
        This share of the regions is taken for some other class in one frame, independently of all others; in addition all vectors of a
        class are turned by a random angle of this standard deviation (radians), anew in every frame.
    seed : int
    """

    patches: int = 0
    noise: float = 0.0
    confusion: float = 0.0
    flicker: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {"patches": 4096, "noise": 1.5, "confusion": 0.5, "flicker": 1.0, "seed": 2**31}
        for name, most in limits.items():
            if not 0 <= getattr(self, name) <= most:
                raise DegenseError(f"a teacher cannot be degraded with {name} {getattr(self, name)}: choose 0 to {most}")

    def __str__(self) -> str:
        return ",".join(f"{field.name}={getattr(self, field.name):g}" for field in fields(self))

    @classmethod
    def parse(cls, words: str) -> Degradation:
        """The inverse of `str`; what is not named keeps the values of `VLM_LIKE`. DegenseError in one sentence."""
        values = {field.name: getattr(VLM_LIKE, field.name) for field in fields(cls)}
        for word in filter(None, words.split(",")):
            name, _, number = word.partition("=")
            try:
                values[name] = type(values[name])(float(number))
            except (KeyError, ValueError, OverflowError):
                allowed = ", ".join(values)
                raise DegenseError(f"a degraded teacher does not understand {word!r}: say name=number, of {allowed}") from None
        return cls(**values)


#: Dense features of a CLIP at 384 × 384 pixels (24 × 24 patches of 16 pixels), as open-vocabulary segmenters use them.
VLM_LIKE = Degradation(patches=24, noise=0.5, confusion=0.15, flicker=0.1)


class DegradedTeacher:
    """Another teacher's answers, degraded; the same seed and frame give the same answer.

    Parameters
    ----------
    teacher : Teacher
        Its index maps say where the classes truly are.
    degradation : Degradation
    """

    pixelwise: bool

    def __init__(self, teacher: Teacher, degradation: Degradation = VLM_LIKE):
        self.teacher, self.degradation = teacher, degradation
        self.frames, self.encoder = teacher.frames, teacher.encoder
        self.pixelwise = degradation.patches == 0
        self.name = f"degraded:{degradation}"
        self.provenance = f"{teacher.provenance}; degraded on purpose ({degradation})"

    def targets(self, frame: int) -> Targets | None:
        """The vectors of the patches float32 [k, D] (of the classes, if nothing makes patches necessary), and the index map."""
        answer = self.teacher.targets(frame)
        if answer is None:
            return None
        vectors, index = answer
        how, rng = self.degradation, np.random.default_rng([self.degradation.seed, 1, frame])
        twin = confusable(vectors)
        assigned = index.copy()
        if how.confusion > 0 or how.flicker > 0:
            for region, truly, mistaken in self._mistakes(index, frame, len(vectors), twin, rng):
                assigned[region & (index == truly)] = mistaken
        present = np.unique(assigned[assigned >= 0])
        vectors = unit_rows((1 - how.confusion) * vectors + how.confusion * vectors[twin])
        vectors = _turned(vectors, how.flicker, rng)
        if how.patches == 0:
            if how.noise == 0:
                return vectors, assigned
            # Without patches each class of a frame is one vector; noise per pixel would be one vector a pixel.
            return _turned(vectors, how.noise, rng), assigned
        shares, patch_of = _patches(assigned, present, how.patches)
        mixed = unit_rows(shares @ vectors[present])
        return _turned(mixed, how.noise, rng), np.where(index >= 0, patch_of, -1).astype(np.int32)

    def _mistakes(
        self, index: np.ndarray, frame: int, classes: int, twin: np.ndarray, rng: np.random.Generator
    ) -> Iterator[tuple[np.ndarray, int, int]]:
        """Cells (bool [H, W]) in which a class is taken for another, with the two classes."""
        how = self.degradation
        persistent = np.random.default_rng([how.seed, 2])
        cells = _cells(index.shape, persistent)
        count = CELLS[0] * CELLS[1]
        since = (
            frame + persistent.integers(0, EPISODE, (count, classes))
        ) // EPISODE  # episodes of different regions begin at different frames
        for cell in range(count):
            inside = cells == cell
            for truly in np.unique(index[inside & (index >= 0)]):
                episode = np.random.default_rng([how.seed, 3, cell, int(truly), int(since[cell, truly])])
                if episode.random() < how.confusion:
                    yield inside, int(truly), int(twin[truly])
                if rng.random() < how.flicker and classes > 1:
                    yield inside, int(truly), int((truly + rng.integers(1, classes)) % classes)


def degraded(name: str, clip: Clip, encoder: TextEncoder) -> DegradedTeacher:
    """The labels degraded like a vision-language model's: "degraded", or with the measure, "degraded:patches=24,noise=0.5,seed=0"."""
    return DegradedTeacher(LabelTeacher(clip, encoder), Degradation.parse(name.partition(":")[2]))


def confusable(vectors: np.ndarray) -> np.ndarray:
    """For each class the one whose vector is most alike, int [k]; of equally like ones the next in order."""
    alike = np.round(vectors.astype(np.float64) @ vectors.T, 3)
    np.fill_diagonal(alike, -np.inf)
    order = (np.arange(len(vectors))[None] - np.arange(len(vectors))[:, None] - 1) % len(vectors)
    return np.lexsort((order, -alike), axis=1)[:, 0] if len(vectors) > 1 else np.zeros(1, int)


def _cells(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Cell of each pixel, int [H, W]: the nearest point of a jittered grid."""
    columns, rows = CELLS
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    points = (np.stack([x, y], -1).reshape(-1, 2) + rng.uniform(0.1, 0.9, (columns * rows, 2))) / CELLS * shape[::-1]
    px, py = np.meshgrid(np.arange(shape[1]), np.arange(shape[0]))
    return ((px[..., None] - points[:, 0]) ** 2 + (py[..., None] - points[:, 1]) ** 2).argmin(-1)


def _patches(index: np.ndarray, present: np.ndarray, along: int) -> tuple[np.ndarray, np.ndarray]:
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
    if angle == 0:
        return vectors.astype(np.float32)
    way = rng.standard_normal(vectors.shape)
    way = unit_rows(way - (way * vectors).sum(1, keepdims=True) * vectors)
    by = rng.normal(0, angle, (len(vectors), 1))
    return (np.cos(by) * vectors + np.sin(by) * way).astype(np.float32)
