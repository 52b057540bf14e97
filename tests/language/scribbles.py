"""Honest strokes: short straight lines drawn into the regions of a label map."""

from __future__ import annotations

import cv2
import numpy as np

from engine.clip import UNLABELLED

LENGTH, WIDTH = 110, 4  # pixels of an 854 × 480 frame


def scribbled(labels: np.ndarray, counts: dict[int, int]) -> np.ndarray:
    """A sparse label map with so many strokes of each class; each goes through a place far from borders and from the last one."""
    strokes = np.full(labels.shape, UNLABELLED, np.uint8)
    for value, count in counts.items():
        depth = cv2.distanceTransform(np.pad((labels == value).astype(np.uint8), 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
        score = depth
        for _ in range(count):
            y, x = np.unravel_index(score.argmax(), score.shape)
            line = np.zeros_like(strokes)
            ends = _longest(depth >= max(3, 0.45 * depth[y, x]), np.array([x, y], float))
            cv2.line(line, *(tuple(int(v) for v in end) for end in ends), 1, WIDTH)
            strokes[(line > 0) & (labels == value)] = value
            score = np.minimum(score, 0.25 * cv2.distanceTransform((line == 0).astype(np.uint8), cv2.DIST_L2, 5))
    return strokes


def _longest(allowed: np.ndarray, middle: np.ndarray) -> list[np.ndarray]:
    """Ends of the longest line through a point that stays where it may and is not longer than `LENGTH`."""
    lines = []
    for angle in np.linspace(0, np.pi, 24, endpoint=False):
        way = np.array([np.cos(angle), np.sin(angle)])
        ends = []
        for sign in (1, -1):
            end = middle
            while np.linalg.norm(end + sign * way - middle) < LENGTH / 2 and _at(allowed, end + sign * way):
                end = end + sign * way
            ends.append(end)
        lines.append(ends)
    return max(lines, key=lambda ends: float(np.linalg.norm(ends[0] - ends[1])))


def _at(allowed: np.ndarray, point: np.ndarray) -> bool:
    x, y = point.round().astype(int)
    return 0 <= x < allowed.shape[1] and 0 <= y < allowed.shape[0] and bool(allowed[y, x])
