"""Points followed through a recording by small windows, as long as the frames lead there and back, and found again where they return."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from typing import NamedTuple

import cv2
import numpy as np

from degense.engine.latest import Latest
from degense.engine.motion.chain_kernel import FrameBlock
from degense.engine.motion.flow import even
from degense.engine.motion.landmarks import Landmarks, carried, landmarks, paired
from degense.engine.motion.lucas_kanade import Pyramid
from degense.engine.motion.window_kernels import padded
from degense.engine.motion.windows import Windows
from degense.engine.progress import Steps
from degense.engine.threads import kernel_threads, made_ahead

PIXELS = 200_000  # frames are matched at about this size
THERE_AND_BACK = 1.0  # pixels: a point that comes back farther from where it began is lost
DRIFTED = 0.03  # of the width: a direct match farther from where the steps lead is another place that looks alike
CLEARLY, LEAST = 1.28, 3.0  # a place is clearly less like a point where it is so many times as unlike, with these grey levels added
EVERY = 8  # frames: points are looked for anew in one of so many
AROUND = 7.0 * np.array([(np.cos(angle), np.sin(angle)) for angle in np.arange(8) * np.pi / 4])  # pixels: what is around a point
ORIGINS = 4  # frames of queries that are looked back at in one frame, and kept
SMOOTH = 0.8  # pixels: σ of the blur before windows are compared
TOGETHER = 4  # frames that points are followed through at once
THREADS = 4  # that frames are made ready on: some 11 MB each, two ahead on each thread


class Matched(NamedTuple):
    """Where frames show points, and how like they look there and elsewhere to what they were."""

    pixels: np.ndarray  # float64 [K, T, 2]; NaN where a point is lost
    unlike: np.ndarray  # float32 [K, T]; grey levels, `Windows.unlike`; NaN where a point is lost
    guessed_unlike: np.ndarray  # float32 [K, T]; the same at the places that were guessed; NaN where none was


class _Frame:
    """A frame at the size that is matched."""

    def __init__(self, rgb: np.ndarray, size: tuple[int, int]):
        small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        blurred = cv2.GaussianBlur(small, (0, 0), SMOOTH)
        self.size, self.even = size, even(small)
        self.pyramid = Pyramid(self.even)
        self.grey, self.colours = padded(cv2.cvtColor(blurred, cv2.COLOR_RGB2GRAY)), padded(blurred)

    @cached_property
    def landmarks(self) -> Landmarks:
        return landmarks(self.even)

    @property
    def planes(self) -> list[np.ndarray]:
        """What a `FrameBlock` holds of a frame, in its order."""
        return [*self.pyramid.values, *self.pyramid.dx, *self.pyramid.dy, self.grey[None], self.colours[None]]


class _Block:
    """Room for a frame and up to `TOGETHER` that follow it, used again: new memory would take longer than to fill it."""

    def __init__(self, frame: _Frame):
        self._planes = [np.empty((TOGETHER + 1, *plane.shape[1:]), np.float32) for plane in frame.planes]

    def filled(self, frames: Sequence[_Frame]) -> FrameBlock:
        """Frames one after the other, until the next ones are filled in."""
        for number, frame in enumerate(frames):
            for room, plane in zip(self._planes, frame.planes, strict=True):
                room[number] = plane[0]
        *octaves, grey, colours = (room[: len(frames)] for room in self._planes)
        count = len(octaves) // 3
        return FrameBlock(tuple(octaves[:count]), tuple(octaves[count : 2 * count]), tuple(octaves[2 * count :]), grey, colours)


def matching(frame_of: Callable[[int], np.ndarray], guesses: np.ndarray, queries: np.ndarray) -> Steps[Matched]:
    """Follow points forwards and backwards from their queries, until they are lost, and look at other `guesses` of their ways too.

    Windows are followed from frame to frame (Lucas-Kanade, in a pyramid); where a direct match with what a point looked like in the frame
    of its query, begun where that ends, looks more like it, the point is there: it does not drift. It is lost when a step does not lead
    back to where it began, or leaves the frame. In each `EVERY`th frame it is looked for anew (`_Chain.find_again`).

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
    origins = Latest(ORIGINS)

    def shown(frame: int) -> _Frame:
        return _Frame(frame_of(int(frame)), size)

    def ready(numbered: tuple[int, int]) -> _Frame:
        number, frame = numbered
        seen = shown(frame)
        if number % EVERY == 0:
            _ = seen.landmarks
        return seen

    for frames in ways:
        chain = _Chain(queries[:, 1:] * scale)
        numbered = list(enumerate(frames, start=done + 1))
        seen = made_ahead(ready, numbered, min(THREADS, kernel_threads()))
        for block in _blocks(numbered, starts):
            yield done / total, "following points"
            done, last = block[-1]
            now = np.array([frame for _, frame in block])
            places, unlike = chain.advance([next(seen) for _ in block])
            chain.begin(np.flatnonzero(starts == last))
            begun = np.flatnonzero(starts * frames.step <= last * frames.step)
            for start in _turn(starts[begun], done):
                chain.find_again(begun[starts[begun] == start], origins.get(start, partial(shown, start)))
            places[:, -1], unlike[:, -1] = chain.places, chain.unlike
            points, columns = np.nonzero((starts * frames.step)[:, None] <= now * frames.step)
            guessed = np.full(places.shape, np.nan)
            guessed[points, columns] = guesses[points, now[columns]] * scale
            guessed_unlike = chain.unlike_in_each(guessed)
            for values, of_block in zip(found, (places / scale, unlike, guessed_unlike), strict=True):
                values[points, now[columns]] = of_block[points, columns]
    return found


def _blocks(numbered: Sequence[tuple[int, int]], starts: np.ndarray) -> Iterator[list[tuple[int, int]]]:
    """Numbered frames, `TOGETHER` at most at once, which end where points begin or are looked for anew."""
    ends = set(starts.tolist())
    block = []
    for number, frame in numbered:
        block.append((number, frame))
        if len(block) == TOGETHER or number % EVERY == 0 or frame in ends or number == numbered[-1][0]:
            yield block
            block = []


def _turn(starts: np.ndarray, number: int) -> list[int]:
    """The frames that points which are looked for in the frame of a number begin in: all that there are, or some in turn."""
    turn, rest = divmod(number, EVERY)
    if rest or not len(starts):
        return []
    frames = np.unique(starts)
    turns = -(-len(frames) // ORIGINS)
    return frames[turn % turns :: turns].tolist()


def clearly_less(unlike: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Where places that are so unlike a point, grey levels, are clearly less like it than others."""
    with np.errstate(invalid="ignore"):
        return unlike + LEAST > CLEARLY * (other + LEAST)


class _Chain:
    """Points on their way in one direction of time: `places` float64 [K, 2], where they are, and `unlike` float32 [K], how unlike their
    queries they look there; NaN of those that are lost."""

    def __init__(self, queries: np.ndarray):
        self._queries, self.places = queries, np.full(queries.shape, np.nan)
        self.unlike = np.full(len(queries), np.nan, np.float32)
        self._windows = Windows(len(queries))
        self._frame: _Frame | None = None
        self._room: _Block | None = None
        self._block: FrameBlock  # the frames that were last advanced through, after the one before them

    def begin(self, points: np.ndarray) -> None:
        """Begin to follow points in the frame that was last advanced to."""
        if len(points) and self._frame is not None:
            self.places[points], self.unlike[points] = self._queries[points], 0
            self._windows.keep(points, self._frame.grey, self._frame.colours, self.places[points])

    def advance(self, frames: Sequence[_Frame]) -> tuple[np.ndarray, np.ndarray]:
        """Follow the points that are not lost through the next frames: places float64 [K, B, 2] and how unlike their queries these look,
        float32 [K, B]; NaN where they are lost."""
        before, self._frame = self._frame or frames[0], frames[-1]
        self._room = self._room or _Block(before)
        self._block = self._room.filled([before, *frames])
        places = np.full((len(self.places), len(frames), 2), np.nan)
        unlike = np.full(places.shape[:2], np.nan, np.float32)
        points = np.flatnonzero(np.isfinite(self.places[:, 0]))
        if len(points):
            found, differ = self._windows.follow(points, self._block, self.places[points], (THERE_AND_BACK, DRIFTED * before.size[0]))
            places[points], unlike[points] = found[:, 1:], differ[:, 1:]
        self.places, self.unlike = places[:, -1].copy(), unlike[:, -1].copy()
        return places, unlike

    def find_again(self, points: np.ndarray, origin: _Frame) -> None:
        """Look for points in the frame that was last advanced to, wherever they were before; `origin` is the frame of their queries.

        A search begins where the landmarks around a point went, and one back where that ends. A point is found where the way back leads to
        its query, and what is around looks clearly less like it: not on plain tissue, nor along an edge. It goes on from there if it was
        lost, or if what it was followed to looks clearly less like it.
        """
        assert self._frame is not None
        frame, queries = self._frame, self._queries[points]
        guesses = carried(queries, paired(origin.landmarks, frame.landmarks))
        known = np.isfinite(guesses).all(1)
        points, queries, guesses = points[known], queries[known], guesses[known]
        there = origin.pyramid.to(frame.pyramid, queries, guesses)
        direct = self._windows.matched(points, frame.grey, there)
        there = np.where((self.unlike_at(points, direct) < self.unlike_at(points, there))[:, None], direct, there)
        back = frame.pyramid.to(origin.pyramid, there, queries + guesses - there)
        led_back = np.linalg.norm(back - queries, axis=1) < THERE_AND_BACK
        near = (np.linalg.norm(there - guesses, axis=1) < DRIFTED * frame.size[0]) & ((there >= 0) & (there < frame.size)).all(1)
        points, there = points[led_back & near], there[led_back & near]
        unlike = self.unlike_at(points, there)
        around = self.unlike_at(np.repeat(points, len(AROUND)), (there[:, None] + AROUND).reshape(-1, 2)).reshape(-1, len(AROUND)).min(1)
        found = clearly_less(around, unlike) & (np.isnan(self.unlike[points]) | clearly_less(self.unlike[points], unlike))
        self.places[points[found]], self.unlike[points[found]] = there[found], unlike[found]

    def unlike_at(self, points: np.ndarray, places: np.ndarray) -> np.ndarray:
        """How unlike their queries the frame that was last advanced to is at places [n, 2] of points, float32 [n]; NaN where a place is."""
        assert self._frame is not None
        return self._windows.unlike(points, self._frame.colours[None], places[:, None])[:, 0]

    def unlike_in_each(self, places: np.ndarray) -> np.ndarray:
        """The same in each of the frames that were last advanced through, at places [K, B, 2] of all points: float32 [K, B]."""
        return self._windows.unlike(np.arange(len(places)), self._block.colours[1:], places)
