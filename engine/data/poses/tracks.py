"""Reduced frames of a clip, without known instruments and at a median depth of 1; points of key frames, followed into other frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import tee

import cv2
import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.motion import confidence, consistent, flow_between, follow, sample, steps_between
from degense.engine.progress import Progress
from degense.engine.vocabulary import instruments

PIXELS = 40_000  # frames are matched at about this size; twice as many are no nearer the truth
EDGE = 7  # pixels around an invalid pixel or an instrument, whose motion bleeds into the tissue beside it
TEXTURE = 0.3  # `confidence` from which flow is more than a guess
CELL = 8  # pixels: at most one point in every cell of this side
HIGHLIGHT = 250  # of the brightest channel: from there on a pixel is taken for a reflection
SIDE = 32  # pixels: pictures smaller than this are too small for optical flow and its borders


class Views:
    """Reduced frames. Nothing is kept: every frame is read once or twice.

    The unit is taken from the frame `first`. `labelled` is whether label maps may be read for where instruments are.
    """

    def __init__(self, clip: Clip, first: int, labelled: bool = False):
        self.clip, self.unit = clip, 1.0
        width, height = clip.size
        self.factor = min(1.0, (PIXELS / (width * height)) ** 0.5)
        self.camera: Camera = clip.cameras[0].scaled(self.factor)
        self._instruments = instruments(clip.classes) if labelled else []
        depth = self.depth(first)[self.tissue(first)]
        #: Lengths here = lengths of the clip × `unit`, chosen so that the median depth of frame `first` is 1 (1 where it has none).
        self.unit = 1 / float(np.median(depth[depth > 0])) if (depth > 0).any() else 1.0

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.camera.width, self.camera.height

    def picture(self, index: int) -> np.ndarray:
        """RGB, uint8 [h, w, 3]."""
        return cv2.resize(self.clip.frame(index), self.size, interpolation=cv2.INTER_AREA)

    def tissue(self, index: int) -> np.ndarray:
        """Valid pixels that no label map calls an instrument, if any may be read, away from the edges of both, bool [h, w]."""
        valid = self.clip.valid(index)
        if self._instruments and (labels := self.clip.labels(index)) is not None:
            valid = valid & ~np.isin(labels, self._instruments)
        small = cv2.resize(valid.astype(np.uint8), self.size, interpolation=cv2.INTER_NEAREST)
        return cv2.erode(small, np.ones((EDGE, EDGE), np.uint8), borderValue=1) > 0

    def depth(self, index: int) -> np.ndarray:
        """Camera depth z, float64 [h, w], 0 where unknown."""
        depth = cv2.resize(self.clip.depth(index), self.size, interpolation=cv2.INTER_NEAREST).astype(np.float64) * self.unit
        return np.where(np.isfinite(depth) & (depth > 0), depth, 0)

    def usable(self, index: int) -> np.ndarray:
        """Tissue whose texture pins its motion down, without reflections, which travel with the light; bool [h, w]."""
        return self._texture(index) > TEXTURE

    def points(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Usable points of known depth on a loose grid: rows and columns, int [n] each."""
        wanted = np.where(self.depth(index) > 0, self._texture(index), 0)
        height, width = wanted.shape
        rows, columns = height // CELL, width // CELL
        cells = wanted[: rows * CELL, : columns * CELL].reshape(rows, CELL, columns, CELL).transpose(0, 2, 1, 3).reshape(rows * columns, -1)
        best = cells.argmax(axis=1)
        row, column = np.divmod(np.arange(rows * columns), columns)
        row, column = row * CELL + best // CELL, column * CELL + best % CELL
        chosen = cells.max(axis=1) > TEXTURE
        return row[chosen], column[chosen]

    def _texture(self, index: int) -> np.ndarray:
        picture = self.picture(index)
        return np.where(self.tissue(index) & (picture.max(axis=2) < HIGHLIGHT), confidence(picture), 0)


FEWEST = 40  # points that a frame needs for its pose
LEFT = 0.4  # share of a key frame's points below which the next key frame takes over
OVERLAP = 0.5  # share of a key frame's points that another must see to be matched with it
PATIENCE = 8  # frames in a row that may show nothing before the camera counts as lost


@dataclass(frozen=True)
class Track:
    """Points of one frame and where they are seen in another."""

    key: int
    frame: int
    index: np.ndarray  # int [n]; which of the key frame's points
    pixels: np.ndarray  # float64 [n, 2]; their places in the key frame, pixels (x, y), centres at .5
    depth: np.ndarray  # float64 [n]; their camera depth z there
    seen: np.ndarray  # float64 [n, 2]; their places in the other frame


class Lost(Exception):
    """The tissue could not be followed; the message says where."""


class Key:
    """A key frame and its points."""

    def __init__(self, views: Views, frame: int):
        self.views, self.frame = views, frame
        self.rows, self.columns = views.points(frame)
        self.depth = views.depth(frame)[self.rows, self.columns]

    def __len__(self) -> int:
        return len(self.rows)

    def track(self, frame: int, out: np.ndarray, back: np.ndarray) -> Track:
        """The points on which flow to another frame and flow back agree, and which are usable there too."""
        arrives = sample(self.views.usable(frame).astype(np.float32), out)[self.rows, self.columns] > 0.5
        index = np.flatnonzero(arrives & consistent(out, back)[self.rows, self.columns])
        row, column = self.rows[index], self.columns[index]
        pixels = np.stack([column, row], 1) + 0.5
        return Track(self.frame, frame, index, pixels, self.depth[index], pixels + out[row, column])


def follow_tissue(views: Views, frames: list[int], progress: Progress) -> tuple[list[Key], list[Track]]:
    """Follow the tissue of key frames through the clip: a new key frame begins where too little of the last one is left.

    Frames that show nothing (dark, blurred, covered) get no track; what comes after them is matched with what came before.
    Lost when it cannot be followed.
    """
    first, *later = frames
    keys, tracks = [Key(views, first)], list[Track]()
    if len(keys[0]) < FEWEST:
        raise Lost(f"frame {first} shows no tissue with texture and depth")
    last, missed = first, 0
    flows = _flows(views, first, later)
    position = 0
    while position < len(later):
        progress(position / len(later), "following tissue to find the camera")
        key, frame = keys[-1], later[position]
        track = key.track(frame, *next(flows))
        left = len(track.index)
        if left < LEFT * len(key) and last != key.frame and len(fresh := Key(views, last)) > max(FEWEST, left):
            keys.append(fresh)
            flows = _flows(views, last, later[position:])
            continue
        position += 1
        if left >= FEWEST:
            tracks.append(track)
            last, missed = frame, 0
            continue
        missed += 1
        if missed > PATIENCE:
            raise Lost(f"tissue cannot be followed beyond frame {last}")
        flows = _flows(views, key.frame, later[position:])
    if not tracks:
        raise Lost(f"tissue cannot be followed beyond frame {last}")
    return keys, tracks


def _flows(views: Views, key: int, frames: list[int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    pictures, ahead = tee(views.picture(i) for i in (key, *frames))
    return follow(pictures, steps_between(ahead))


def close_loops(keys: list[Key], viewmats: np.ndarray, progress: Progress) -> list[Track]:
    """Tracks between key frames that do not follow each other but see the same tissue.

    They are searched from where the poses so far, float64 [T, 4, 4] in the unit of the views, predict the tissue.
    """
    found = []
    for i, key in enumerate(keys[2:], 2):
        progress(i / len(keys), "closing loops")
        for other in keys[: i - 1]:
            out, overlap = _foretold(other, key, viewmats)
            if overlap < OVERLAP:
                continue
            back, _ = _foretold(key, other, viewmats)
            here, there = (k.views.picture(k.frame) for k in (other, key))
            track = other.track(key.frame, flow_between(here, there, out), flow_between(there, here, back))
            if len(track.index) >= max(FEWEST, 0.5 * overlap * len(other)):
                found.append(track)
    return found


def _foretold(key: Key, other: Key, viewmats: np.ndarray) -> tuple[np.ndarray, float]:
    """Flow that the poses foretell, float32 [h, w, 2], and the share of the key frame's points that stay in the picture."""
    views = key.views
    depth = views.depth(key.frame)
    width, height = views.size
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), -1)
    world = replace(views.camera, viewmat=viewmats[key.frame]).unproject(pixels, np.where(depth > 0, depth, np.median(key.depth)))
    seen, _ = replace(views.camera, viewmat=viewmats[other.frame]).project(world)
    inside = np.all((seen > 0) & (seen < (width, height)), axis=-1)
    return np.clip(seen - pixels, -width, width).astype(np.float32), float(inside[key.rows, key.columns].mean())
