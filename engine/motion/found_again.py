"""Points looked for anew in a frame, wherever they were before it, by what they looked like where they began."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from threading import Lock

import numpy as np

from degense.engine.latest import Latest
from degense.engine.motion.landmarks import carried, paired
from degense.engine.motion.matched_frame import MatchedFrame
from degense.engine.motion.windows import Windows

THERE_AND_BACK = 1.0  # pixels: a point that comes back farther from where it began is lost
DRIFTED = 0.03  # of the width: a direct match farther from where the steps lead is another place that looks alike
CLEARLY, LEAST = 1.28, 3.0  # a place is clearly less like a point where it is so many times as unlike, with these grey levels added
AROUND = 7.0 * np.array([(np.cos(angle), np.sin(angle)) for angle in np.arange(8) * np.pi / 4])  # pixels: what is around a point
ORIGINS = 4  # frames of queries that are looked back at in one frame, and kept

#: Rows int64 [n] of points, places float64 [n, 2] where a frame shows them, and how unlike their queries these look, float32 [n].
Found = tuple[np.ndarray, np.ndarray, np.ndarray]


def clearly_less(unlike: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Where places that are so unlike a point, grey levels, are clearly less like it than others."""
    with np.errstate(invalid="ignore"):
        return unlike + LEAST > CLEARLY * (other + LEAST)


class Queries:
    """Points and the frames that they begin in: what they look like there, for all threads.

    Parameters
    ----------
    places : float64 [K, 2]
        Pixels of frames at the size that is matched.
    starts : int [K]
        Numbers of frames.
    frame_of : callable
        Gives a frame by its number.
    """

    def __init__(self, places: np.ndarray, starts: np.ndarray, frame_of: Callable[[int], MatchedFrame]):
        self.places, self.starts, self.windows = places, starts, Windows(len(places))
        self._frame_of, self._origins = frame_of, Latest(ORIGINS)
        self._kept: set[int] = set()
        self._lock = Lock()

    def begin(self, start: int, frame: MatchedFrame) -> np.ndarray:
        """Keep what the points that begin in a frame look like, unless it is kept; their rows."""
        points = np.flatnonzero(self.starts == start)
        with self._lock:
            if len(points) and start not in self._kept:
                self.windows.keep(points, frame.grey, frame.colours, self.places[points])
                self._kept.add(start)
        return points

    def found_in(self, frame: MatchedFrame, start: int) -> Found:
        """Points that begin in the frame `start`, where another frame shows them for sure.

        A search begins where the landmarks around a point went, and one back where that ends. A point is found where the way back leads to
        its query, and what is around looks clearly less like it: not on plain tissue, nor along an edge.
        """
        origin = self._origins.get(start, partial(self._frame_of, start))
        points = self.begin(start, origin)
        queries = self.places[points]
        guesses = carried(queries, paired(origin.landmarks, frame.landmarks))
        known = np.isfinite(guesses).all(1)
        points, queries, guesses = points[known], queries[known], guesses[known]
        there = origin.pyramid.to(frame.pyramid, queries, guesses)
        direct = self.windows.matched(points, frame.grey, there)
        there = np.where((self.unlike(points, frame, direct) < self.unlike(points, frame, there))[:, None], direct, there)
        back = frame.pyramid.to(origin.pyramid, there, queries + guesses - there)
        led_back = np.linalg.norm(back - queries, axis=1) < THERE_AND_BACK
        near = (np.linalg.norm(there - guesses, axis=1) < DRIFTED * frame.size[0]) & ((there >= 0) & (there < frame.size)).all(1)
        points, there = points[led_back & near], there[led_back & near]
        unlike = self.unlike(points, frame, there)
        around = self.unlike(np.repeat(points, len(AROUND)), frame, (there[:, None] + AROUND).reshape(-1, 2)).reshape(-1, len(AROUND))
        found = clearly_less(around.min(1), unlike)
        return points[found], there[found], unlike[found]

    def unlike(self, points: np.ndarray, frame: MatchedFrame, places: np.ndarray) -> np.ndarray:
        """How unlike their queries a frame is at places [n, 2] of points, float32 [n]; NaN where a place is."""
        return self.windows.unlike(points, frame.colours[None], np.zeros(1, np.int64), places[:, None])[:, 0]
