"""Points followed through a recording by small windows, as long as the frames lead there and back."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np

from degense.engine.motion.flow import even
from degense.engine.motion.windows import Windows
from degense.engine.progress import Steps

PIXELS = 200_000  # frames are matched at about this size
SIDE, LEVELS = 15, 3  # of the windows that are followed from frame to frame: pixels, and octaves above the finest
ENOUGH = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)  # rounds in each octave, or pixels that the last one moved
THERE_AND_BACK = 1.0  # pixels: a point that comes back farther from where it began is lost
DRIFTED = 0.03  # of the width: a direct match farther from where the steps lead is another place that looks alike
SMOOTH = 0.8  # pixels: σ of the blur before windows are compared


class Matched(NamedTuple):
    """Where frames show points, and how like they look there and elsewhere to what they were."""

    pixels: np.ndarray  # float64 [K, T, 2]; NaN where a point is lost
    unlike: np.ndarray  # float32 [K, T]; grey levels, `engine.motion.windows.unlikeness`; NaN where a point is lost
    guessed_unlike: np.ndarray  # float32 [K, T]; the same at the places that were guessed; NaN where none was


class _Frame:
    """A frame at the size that is matched."""

    def __init__(self, rgb: np.ndarray, size: tuple[int, int]):
        small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        self.even, self.colours = even(small), cv2.GaussianBlur(small, (0, 0), SMOOTH)
        self.grey = cv2.cvtColor(self.colours, cv2.COLOR_RGB2GRAY).astype(np.float32)


def matching(frame_of: Callable[[int], np.ndarray], guesses: np.ndarray, queries: np.ndarray) -> Steps[Matched]:
    """Follow points forwards and backwards from their queries, until they are lost, and look at other `guesses` of their ways too.

    Windows are followed from frame to frame (Lucas-Kanade, in a pyramid); where a direct match with what a point looked like in the frame
    of its query, begun where that ends, looks more like it, the point is there: it does not drift. It is lost when a step does not lead
    back to where it began, or leaves the frame.

    Parameters
    ----------
    frame_of : callable
        Gives a frame by its number, uint8 [H, W, 3].
    guesses : float [K, T, 2]
        Other pixel positions of the points; NaN where there is none.
    queries : float [K, 3]
        Frame, x and y of each point, pixels.
    """
    count = guesses.shape[1]
    starts = queries[:, 0].round().astype(int)
    height, width = frame_of(0).shape[:2]
    shrink = min(1.0, (PIXELS / (width * height)) ** 0.5)
    size = max(16, round(width * shrink)), max(16, round(height * shrink))
    scale = np.array(size) / (width, height)
    found = Matched(np.full(guesses.shape, np.nan), *(np.full(guesses.shape[:2], np.nan, np.float32) for _ in range(2)))
    ways = [range(starts.min(initial=count), count), range(starts.max(initial=-1), -1, -1)]
    done, total = 0, sum(map(len, ways))
    for frames in ways:
        chain = _Chain(queries[:, 1:] * scale)
        for frame in frames:
            yield done / max(total, 1), "following points"
            done += 1
            chain.advance(_Frame(frame_of(frame), size))
            chain.begin(np.flatnonzero(starts == frame))
            begun = np.flatnonzero(starts * frames.step <= frame * frames.step)
            found.pixels[begun, frame] = chain.places[begun] / scale
            found.unlike[begun, frame] = chain.unlike[begun]
            found.guessed_unlike[begun, frame] = chain.unlike_at(begun, guesses[begun, frame] * scale)
    return found


class _Chain:
    """Points on their way in one direction of time: `places` float64 [K, 2], where they are, and `unlike` float32 [K], how unlike their
    queries they look there; NaN of those that are lost."""

    def __init__(self, queries: np.ndarray):
        self._queries, self.places = queries, np.full(queries.shape, np.nan)
        self.unlike = np.full(len(queries), np.nan, np.float32)
        self._windows = Windows(len(queries))
        self._frame: _Frame | None = None

    def begin(self, points: np.ndarray) -> None:
        """Begin to follow points in the frame that was last advanced to."""
        if len(points) and self._frame is not None:
            self.places[points], self.unlike[points] = self._queries[points], 0
            self._windows.keep(points, self._frame.grey, self._frame.colours, self.places[points])

    def advance(self, frame: _Frame) -> None:
        """Follow the points that are not lost to the next frame."""
        before, self._frame = self._frame, frame
        points = np.flatnonzero(np.isfinite(self.places[:, 0]))
        if before is None or not len(points):
            return
        start = self.places[points]
        there = _step(before.even, frame.even, start)
        astray = np.linalg.norm(_step(frame.even, before.even, there) - start, axis=1)
        kept = (astray < THERE_AND_BACK) & ((there >= 0) & (there < frame.even.shape[::-1])).all(1)
        self.places[points[~kept]], self.unlike[points[~kept]] = np.nan, np.nan
        points, there = points[kept], there[kept]
        if len(points):
            direct = self._windows.matched(points, frame.grey, there)
            near = np.linalg.norm(direct - there, axis=1) < DRIFTED * frame.even.shape[1]
            chained, matched = self.unlike_at(points, there), np.where(near, self.unlike_at(points, direct), np.inf)
            self.places[points] = np.where((matched < chained)[:, None], direct, there)
            self.unlike[points] = np.minimum(matched, chained)

    def unlike_at(self, points: np.ndarray, places: np.ndarray) -> np.ndarray:
        """How unlike their queries the frame that was last advanced to is at places [n, 2] of points; NaN of a place that is not known."""
        assert self._frame is not None
        known = np.isfinite(places).all(1)
        found = np.full(len(points), np.nan, np.float32)
        if known.any():
            found[known] = self._windows.unlike(points[known], self._frame.colours, places[known])
        return found


def _step(a: np.ndarray, b: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Where windows of frame a at places [n, 2] are in frame b, uint8 [H, W] both; float64 [n, 2]."""
    start = (places - 0.5).astype(np.float32)[:, None]
    found, _, _ = cv2.calcOpticalFlowPyrLK(a, b, start, None, winSize=(SIDE, SIDE), maxLevel=LEVELS, criteria=ENOUGH)
    return found[:, 0].astype(np.float64) + 0.5
