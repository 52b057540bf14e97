"""Points followed through a recording by small windows, as long as the frames lead there and back, and found again where they return."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from degense.engine.motion.chain_kernel import FrameBlock
from degense.engine.motion.found_again import DRIFTED, ORIGINS, THERE_AND_BACK, Found, Queries, clearly_less
from degense.engine.motion.matched_frame import FrameRing, MatchedFrame
from degense.engine.progress import Steps
from degense.engine.threads import AHEAD, kernel_threads, made_ahead

PIXELS = 200_000  # frames are matched at about this size
EVERY = 8  # frames: points are looked for anew in one of so many
TOGETHER = 4  # frames that points are followed through at once
THREADS = 4  # that frames are made ready on: some 11 MB each, two ahead on each thread


class Matched(NamedTuple):
    """Where frames show points, and how like they look there and elsewhere to what they were."""

    pixels: np.ndarray  # float64 [K, T, 2]; NaN where a point is lost
    unlike: np.ndarray  # float32 [K, T]; grey levels, `Windows.unlike`; NaN where a point is lost
    guessed_unlike: np.ndarray  # float32 [K, T]; the same at the places that were guessed; NaN where none was


def matching(frame_of: Callable[[int], np.ndarray], guesses: np.ndarray, queries: np.ndarray) -> Steps[Matched]:
    """Follow points forwards and backwards from their queries, until they are lost, and look at other `guesses` of their ways too.

    Windows are followed from frame to frame (Lucas-Kanade, in a pyramid); where a direct match with what a point looked like in the frame
    of its query, begun where that ends, looks more like it, the point is there: it does not drift. It is lost when a step does not lead
    back to where it began, or leaves the frame. In each `EVERY`th frame it is looked for anew (`Queries.found_in`), on other threads.

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
    first = frame_of(0)
    height, width = first.shape[:2]
    shrink = min(1.0, (PIXELS / (width * height)) ** 0.5)
    size = max(16, round(width * shrink)), max(16, round(height * shrink))
    scale = np.array(size) / (width, height)
    found = Matched(np.full(guesses.shape, np.nan), *(np.full(guesses.shape[:2], np.nan, np.float32) for _ in range(2)))
    ways = [range(starts.min(initial=count), count), range(starts.max(initial=-1), -1, -1)]
    done, total = 0, sum(map(len, ways))
    threads = min(THREADS, kernel_threads())
    ring = FrameRing(MatchedFrame(first, size), AHEAD * threads + TOGETHER)
    begun = Queries(queries[:, 1:] * scale, starts, lambda frame: MatchedFrame(frame_of(frame), size))

    def ready(step: int, numbered: tuple[int, int]) -> tuple[MatchedFrame, list[Found]]:
        number, frame = numbered
        seen = MatchedFrame(frame_of(frame), size, ring.planes(number))
        return seen, [begun.found_in(seen, start) for start in _turn(starts[starts * step <= frame * step], number)]

    for frames in ways:
        chain = _Chain(begun, ring)
        numbered = list(enumerate(frames, start=done + 1))
        seen = made_ahead(partial(ready, frames.step), numbered, threads)
        for block in _blocks(numbered, starts):
            yield done / total, "following points"
            done, last = block[-1]
            numbers, now = np.array(block).T
            *_, (frame, again) = [next(seen) for _ in block]
            places, unlike = chain.advance(numbers)
            chain.begin(last, frame)
            for those in again:
                chain.go_on_from(those)
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


class _Chain:
    """Points on their way in one direction of time: `places` float64 [K, 2], where they are, and `unlike` float32 [K], how unlike their
    queries they look there; NaN of those that are lost."""

    def __init__(self, queries: Queries, ring: FrameRing):
        self._queries, self._ring = queries, ring
        self.places = np.full(queries.places.shape, np.nan)
        self.unlike = np.full(len(self.places), np.nan, np.float32)
        self._number: int | None = None
        self._block: FrameBlock  # the frames that were last advanced through, after the one before them

    def begin(self, start: int, frame: MatchedFrame) -> None:
        """Begin to follow the points of a frame, the one that was last advanced to."""
        points = self._queries.begin(start, frame)
        self.places[points], self.unlike[points] = self._queries.places[points], 0

    def advance(self, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Follow the points that are not lost through the next frames, by their numbers in the ring: places float64 [K, B, 2] and how
        unlike their queries these look, float32 [K, B]; NaN where they are lost."""
        before = numbers[0] if self._number is None else self._number
        self._block, self._number = self._ring.block([before, *numbers]), numbers[-1]
        places = np.full((len(self.places), len(numbers), 2), np.nan)
        unlike = np.full(places.shape[:2], np.nan, np.float32)
        points = np.flatnonzero(np.isfinite(self.places[:, 0]))
        if len(points):
            limits = THERE_AND_BACK, DRIFTED * self._ring.size[0]
            found, differ = self._queries.windows.follow(points, self._block, self.places[points], limits)
            places[points], unlike[points] = found[:, 1:], differ[:, 1:]
        self.places, self.unlike = places[:, -1].copy(), unlike[:, -1].copy()
        return places, unlike

    def go_on_from(self, found: Found) -> None:
        """Go on from where points were found again in the frame that was last advanced to: those that were lost, and those that were
        followed to what looks clearly less like them."""
        points, places, unlike = found
        better = np.isnan(self.unlike[points]) | clearly_less(self.unlike[points], unlike)
        self.places[points[better]], self.unlike[points[better]] = places[better], unlike[better]

    def unlike_in_each(self, places: np.ndarray) -> np.ndarray:
        """How unlike their queries the frames that were last advanced through are at places [K, B, 2] of all points, float32 [K, B]; NaN
        where a place is."""
        return self._queries.windows.unlike(np.arange(len(places)), self._block.colours, self._block.numbers[1:], places)
