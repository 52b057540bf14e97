"""Landmarks of frames: places that are known again by their look, however far they moved, and where others are by those around them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from degense.engine.threads import run_kernel, take_ticket

MOST, CONTRAST = 1000, 0.01  # landmarks of a frame, and how weak they may be: tissue has few strong ones
SECOND = 0.8  # a landmark's look may differ from its other's by this share of what it differs by from the next most alike
NEAREST = 8  # landmarks that say where a place between them is
TOGETHER = 3.0  # pixels: landmarks that move as one similarity does are at most so far from where it takes them
CHUNK = 32  # places that a thread takes at once
LEAST = 3  # of them; two fit any similarity
GROWN = 1.6  # at most so many times as large or as small


class Landmarks(NamedTuple):
    """Of a frame."""

    places: np.ndarray  # float64 [M, 2]; pixels
    looks: np.ndarray  # float32 [M, 128]; unit vectors


def landmarks(grey: np.ndarray) -> Landmarks:
    """Those of a frame, uint8 [H, W]: SIFT (Lowe, IJCV 2004), compared as RootSIFT (Arandjelović & Zisserman, CVPR 2012).

    OpenCV doubles the frame first, for details that no point needs; so it is halved.
    """
    small = cv2.resize(grey, (max(grey.shape[1] // 2, 1), max(grey.shape[0] // 2, 1)), interpolation=cv2.INTER_AREA)
    points, looks = cv2.SIFT.create(MOST, contrastThreshold=CONTRAST).detectAndCompute(small, None)
    if looks is None:
        return Landmarks(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    scale = np.array(grey.shape[::-1]) / small.shape[::-1]
    return Landmarks((np.array([point.pt for point in points]) + 0.5) * scale, np.sqrt(looks / np.maximum(looks.sum(1, keepdims=True), 1)))


def paired(a: Landmarks, b: Landmarks) -> tuple[np.ndarray, np.ndarray]:
    """Places [n, 2] in both frames of landmarks that look most alike both ways, and clearly more so than any other."""
    if not len(a.places) or len(b.places) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    alike = a.looks @ b.looks.T
    rows, best, back = np.arange(len(alike)), alike.argmax(1), alike.argmax(0)
    first = alike[rows, best]
    alike[rows, best] = -1
    kept = (back[best] == rows) & (1 - first < SECOND**2 * (1 - alike.max(1)))
    return a.places[kept], b.places[best[kept]]


def carried(places: np.ndarray, ends: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Where places [k, 2] of a frame are in another, by the similarity that most of the nearest `paired` landmarks [n, 2] agree on.

    float64 [k, 2]; NaN where fewer than `LEAST` agree.
    """
    here, there = ends
    found = np.full(len(places), complex(np.nan, np.nan))
    if len(here) >= LEAST:
        run_kernel(_carry, _complex(places), _complex(here), _complex(there), found)
    return np.stack([found.real, found.imag], 1)


def _complex(places: np.ndarray) -> np.ndarray:
    return places[:, 0] + 1j * places[:, 1]


@njit(nogil=True, error_model="numpy")
def _square(z):
    return z.real * z.real + z.imag * z.imag


@njit(nogil=True, error_model="numpy")
def _agreeing(here, there, i, j):
    """The similarity z ↦ there + ratio (z − here) through two of n pairs of complex numbers: its ratio, how many agree with it, and their
    squared distances from it together; none where the two are too near each other, or it grows too much."""
    span = here[j] - here[i]
    if _square(span) < TOGETHER**2:
        return span, 0, 0.0
    ratio = (there[j] - there[i]) * span.conjugate() / _square(span)
    if not 1 / GROWN**2 < _square(ratio) < GROWN**2:
        return ratio, 0, 0.0
    count, apart = 0, 0.0
    for other in range(len(here)):
        away = _square(there[i] + ratio * (here[other] - here[i]) - there[other])
        if away <= TOGETHER**2:
            count, apart = count + 1, apart + away
    return ratio, count, apart


@njit(nogil=True, error_model="numpy")
def _nearest(place, here, rows):
    """Write the rows of the nearest of complex numbers [n], the nearest first, int64 [NEAREST at most]."""
    for row in range(len(here)):
        apart, at = _square(here[row] - place), min(row, len(rows))
        while at > 0 and apart < _square(here[rows[at - 1]] - place):
            at -= 1
            if at + 1 < len(rows):
                rows[at + 1] = rows[at]
        if at < len(rows):
            rows[at] = row


@njit(nogil=True, cache=True, error_model="numpy")
def _carry(places, here, there, found, counter):
    """Places [k] by the similarity through two of the nearest of n landmarks, complex [n], that most agree with, most closely; all as
    x + i y."""
    rows = np.empty(min(NEAREST, len(here)), np.int64)
    while True:
        first = take_ticket(counter) * CHUNK
        if first >= len(places):
            return
        for k in range(first, min(first + CHUNK, len(places))):
            _nearest(places[k], here, rows)
            near_here, near_there = here[rows], there[rows]
            most, nearest = LEAST - 1, np.inf
            for i in range(len(rows)):
                for j in range(i):
                    ratio, count, apart = _agreeing(near_here, near_there, i, j)
                    if count > most or (count == most and apart < nearest and count >= LEAST):
                        most, nearest = count, apart
                        found[k] = near_there[i] + ratio * (places[k] - near_here[i])
