"""The teacher of a few scribbles: their classes are spread over the frame by a random walk, and over the clip along the optical flow.

In a frame with strokes, the classes spread over the regions that are connected to the strokes and have a similar appearance
(`Regions.walk`). The appearance of each class is estimated from the strokes and, in further rounds, from the regions whose class is
confident. In every other frame the walk starts from the label map of the nearest frame with strokes, warped along the flow where the flow
is consistent. Confidence is calibrated on halves of strokes that are held out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from importlib.metadata import version
from typing import Any

import cv2
import numpy as np

from degense.engine.clip import UNLABELLED, Clip
from degense.engine.errors import ClipError
from degense.engine.motion import consistent, follow, sample
from degense.engine.progress import Progress, silent
from degense.engine.semantics.teachers.regions import Appearance, Regions
from degense.engine.semantics.teachers.target_cache import clip_settings, digest
from degense.engine.semantics.teachers.teacher import Targets, soft_targets
from degense.engine.semantics.text.encoder import TextEncoder

REVISION = 3  # of the method: another one has other targets
ROUNDS = 3  # of estimating the appearance of the classes
CONFIDENT = 0.6  # probability from which a region counts in the next round
STROKE_WEIGHT, WARPED_WEIGHT = 1e3, 0.3  # of `Regions.walk`
LEAST_PROBABILITY = 0.35  # of the likeliest class; below it there is no target, above it the mixture of classes expresses the confidence
FLOW_PIXELS = 80_000  # flow is followed at about this size
TEMPERATURES = np.geomspace(0.4, 4, 24)


class StrokeTeacher:
    """Soft label maps of all training frames from sparse ones of a few.

    Strokes on held-out frames are never used, except where a clip has no others. `encoder` is extended with the clip's class names.
    ClipError if the clip has no strokes, or of one class only.
    """

    name = "strokes"
    pixelwise = True

    def __init__(self, clip: Clip, encoder: TextEncoder):
        stroked = clip.stroked_frames
        if not stroked:
            raise ClipError(f"Clip '{clip.name}' has no strokes; draw some, or add strokes/ and classes.json.")
        held_out = set(clip.test_frames)
        self.sources = [frame for frame in stroked if frame not in held_out] or stroked  # frames whose strokes are used
        self._clip = clip
        self._strokes = {frame: self._read(frame) for frame in self.sources}
        drawn = np.unique(np.concatenate([values[values != UNLABELLED] for values in self._strokes.values()]))
        self.classes = [int(value) for value in drawn]  # values of `clip.classes` that have strokes; targets are of no others
        if len(self.classes) < 2:
            raise ClipError(f"The strokes of clip '{clip.name}' inside its field of view name fewer than two classes; scribble others too.")
        self.frames = clip.train_frames
        self.encoder = encoder.with_classes(clip.classes)
        self.vectors = self.encoder.encode([clip.classes[value] for value in self.classes])
        names = ", ".join(clip.classes[value] for value in self.classes)
        frames = ", ".join(str(frame) for frame in self.sources[:6]) + (", …" if len(self.sources) > 6 else "")
        self.provenance = f"strokes on {_plural(len(self.sources), 'frame')} ({frames}) naming {names}, encoder {self.encoder.name}"

    def _read(self, frame: int) -> np.ndarray:
        strokes = self._clip.strokes(frame)
        assert strokes is not None
        return np.where(self._clip.valid(frame), strokes, UNLABELLED)

    @property
    def settings(self) -> dict[str, Any]:
        """What the targets depend on."""
        clip = self._clip
        contents = [part for frame in self.sources for part in (str(frame).encode(), self._strokes[frame], clip.valid(frame))]
        return {
            **clip_settings(clip),
            "teacher": self.name,
            "revision": REVISION,
            "strokes": digest(*contents),
            "encoder": self.encoder.name,
            "versions": {name: version(name) for name in ("opencv-contrib-python-headless", "numpy", "scipy")},
        }

    def compute(self, frames: Sequence[int], progress: Progress = silent) -> Iterator[tuple[int, Targets | None]]:
        """Targets of these frames, those with strokes first."""
        wanted, done = set(frames), 0
        progress(0, "learning the appearance of the classes")
        for source in self.sources:
            near = [i for i in sorted({*self.frames, source}) if self._nearest(i) == source]
            if not wanted & set(near):
                continue
            regions, found = self._regions[source], self._calibrated(source)
            start = found.astype(np.float32)[regions.of]
            if source in wanted:
                done += 1
                yield source, self._targets(source, regions, found)
            for order in ([i for i in near if i >= source], [i for i in near if i <= source][::-1]):
                last = max((k for k, i in enumerate(order) if i in wanted and i != source), default=-1)
                for frame, warped, consistent_flow in self._warped(order[: last + 1], start):
                    progress(done / len(wanted), "spreading strokes over the clip")
                    if frame in wanted:
                        done += 1
                        yield frame, self._targets(frame, *self._walked(frame, warped, consistent_flow))

    def _nearest(self, frame: int) -> int:
        return min(self.sources, key=lambda source: abs(source - frame))

    # -- frames with strokes ---------------------------------------------------------------------------------------------------------------
    @cached_property
    def _regions(self) -> dict[int, Regions]:
        return {frame: Regions(self._clip.frame(frame), self._clip.valid(frame)) for frame in self.sources}

    @cached_property
    def _learned(self) -> tuple[Appearance, dict[int, np.ndarray]]:
        """Appearance of the classes, and class probabilities of the regions of frames with strokes."""
        return self._learn(self._strokes)

    def _learn(self, strokes: dict[int, np.ndarray]) -> tuple[Appearance, dict[int, np.ndarray]]:
        seeds = {frame: self._seeds(frame, values) for frame, values in strokes.items()}
        features = np.concatenate([self._regions[frame].features for frame in strokes])
        stroked = np.concatenate([known * (weight > 0)[:, None] for known, weight in seeds.values()])
        weights = stroked
        found: dict[int, np.ndarray] = {}
        for _ in range(ROUNDS):
            appearance = Appearance.fit(features, weights)
            found = {
                frame: self._regions[frame].walk(appearance.likeness(self._regions[frame].features), known, weight)
                for frame, (known, weight) in seeds.items()
            }
            confident = [np.where((p > CONFIDENT) & self._regions[frame].inside[:, None], p, 0) for frame, p in found.items()]
            weights = np.concatenate(confident) + stroked
        return appearance, found

    def _seeds(self, frame: int, strokes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shares of the classes among the strokes that cross each region [n, k], and their weight [n]."""
        regions = self._regions[frame]
        counts = np.stack([regions.share(strokes == value) for value in self.classes], 1)
        total = counts.sum(1)
        return counts / np.maximum(total, 1e-12)[:, None], STROKE_WEIGHT * (total > 0)

    @cached_property
    def temperature(self) -> float:
        """T, by whose inverse probabilities are raised (T < 1 sharpens them) so that they are calibrated on held-out strokes.

        One half of every stroke is held out, then the other.
        """
        logs: list[np.ndarray] = []
        for half in (0, 1):
            strokes = {frame: _halved(values, half) for frame, values in self._strokes.items()}
            _, found = self._learn(strokes)
            for frame, values in self._strokes.items():
                held = (values != UNLABELLED) & (strokes[frame] == UNLABELLED)
                for value in np.unique(values[held]):
                    there = np.unique(self._regions[frame].of[held & (values == value)])
                    log = np.log(np.maximum(found[frame][there], 1e-6))
                    logs.append(log[:, [self.classes.index(int(value)), *range(len(self.classes))]])
        # each class counts alike, however many regions its strokes cross
        losses = [np.mean([(np.log(np.exp(log[:, 1:] / t).sum(1)) - log[:, 0] / t).mean() for log in logs]) for t in TEMPERATURES]
        return float(TEMPERATURES[int(np.argmin(losses))])

    def _calibrated(self, frame: int) -> np.ndarray:
        """Calibrated class probabilities of the regions of a frame with strokes, float64 [n, k]."""
        raised = np.maximum(self._learned[1][frame], 1e-6) ** (1 / self.temperature)
        return raised / raised.sum(1, keepdims=True)

    # -- other frames ----------------------------------------------------------------------------------------------------------------------
    def _warped(self, order: list[int], start: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """The map of the first frame of `order` warped along the flow to each of the others, and where the flow is consistent [H, W]."""
        if len(order) < 2:
            return
        width, height = self._clip.size
        shrink = min(1.0, (FLOW_PIXELS / (width * height)) ** 0.5)
        size = max(16, round(width * shrink)), max(16, round(height * shrink))
        small = _resized(start, size)
        here = self._small_valid(order[0], size)
        flows = follow(cv2.resize(self._clip.frame(i), size, interpolation=cv2.INTER_AREA) for i in order)
        for frame, (out, back) in zip(order[1:], flows, strict=True):
            moved = np.stack([sample(channel, back) for channel in np.moveaxis(small, -1, 0)], -1)
            arrives = sample(here.astype(np.float32), back) > 0.99
            consistent_flow = arrives & self._small_valid(frame, size) & consistent(back, out) & np.isfinite(moved).all(-1)
            yield (
                frame,
                _resized(np.where(consistent_flow[..., None], moved, 0), (width, height)),
                cv2.resize(consistent_flow.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0,
            )

    def _small_valid(self, frame: int, size: tuple[int, int]) -> np.ndarray:
        return cv2.resize(self._clip.valid(frame).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0

    def _walked(self, frame: int, warped: np.ndarray, consistent_flow: np.ndarray) -> tuple[Regions, np.ndarray]:
        """Regions of a frame and their class probabilities, from those warped to it and from its appearance."""
        regions = Regions(self._clip.frame(frame), self._clip.valid(frame))
        known = regions.mean(np.where(consistent_flow[..., None], warped, 0)).astype(np.float64)
        known /= np.maximum(known.sum(1, keepdims=True), 1e-12)
        weight = WARPED_WEIGHT * regions.share(consistent_flow)
        return regions, regions.walk(self._learned[0].likeness(regions.features), known, weight)

    def _targets(self, frame: int, regions: Regions, found: np.ndarray) -> Targets | None:
        vectors, index = soft_targets(found, self.vectors, found.max(1) >= LEAST_PROBABILITY)
        index_map = np.where(self._clip.valid(frame), index[regions.of], -1).astype(np.int32)
        return (vectors, index_map) if (index_map >= 0).any() else None


def _halved(strokes: np.ndarray, half: int) -> np.ndarray:
    """A map with one half (0 or 1) of each stroke: cut across its length, at its middle."""
    kept = np.full_like(strokes, UNLABELLED)
    for value in np.unique(strokes[strokes != UNLABELLED]):
        count, parts = cv2.connectedComponents((strokes == value).astype(np.uint8), connectivity=8)
        for part in range(1, count):
            y, x = np.nonzero(parts == part)
            points = np.stack([x, y], 1) - np.array([x.mean(), y.mean()])
            along = points @ np.linalg.svd(points, full_matrices=False)[2][0]
            chosen = (along > np.median(along)) == bool(half)
            kept[y[chosen], x[chosen]] = value
    return kept


def _resized(maps: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Maps [H, W, k], any k, at another (width, height)."""
    shrinks = size[0] < maps.shape[1]
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.stack([cv2.resize(channel, size, interpolation=how) for channel in np.moveaxis(maps, -1, 0)], -1)


def _plural(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
