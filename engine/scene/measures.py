"""Lengths, areas and volumes of points that move with the material."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial import Delaunay, QhullError

#: Points that an outline is covered with, roughly.
SAMPLES = 150


class SurfaceSamples(NamedTuple):
    """Points on a surface and the triangles between them."""

    pixels: np.ndarray  # float64 [K, 2], (x, y); the corners of the outline come first
    triangles: np.ndarray  # int [M, 3], indices of points


def path_length(positions: np.ndarray) -> np.ndarray:
    """Length of the line through points float [K, T, 3] at each time, float64 [T]; NaN where a point is unknown."""
    return np.linalg.norm(np.diff(positions, axis=0), axis=-1).sum(0)


def cover(outline: np.ndarray, samples: int = SAMPLES) -> SurfaceSamples:
    """Points on and inside an outline float [n, 2] of pixels, n ≥ 3, and triangles that cover its inside. Without area, no triangles."""
    outline = np.asarray(outline, np.float64)
    spacing = float(np.sqrt(max(cv2.contourArea(outline.astype(np.float32)), 1e-6) / samples))
    sides = np.roll(outline, -1, 0) - outline
    counts = np.maximum(1, np.ceil(np.linalg.norm(sides, axis=1) / (2 * spacing))).astype(int)
    edge = [start + side * (step / count) for start, side, count in zip(outline, sides, counts, strict=True) for step in range(1, count)]
    low, high = outline.min(0), outline.max(0)
    grid = np.stack(np.meshgrid(*(np.arange(a + spacing / 2, b, spacing) for a, b in zip(low, high, strict=True))), -1).reshape(-1, 2)
    deep = [point for point in grid if _depth_inside(outline, point) > spacing / 2]
    pixels = np.array([*outline, *edge, *deep])
    try:
        triangles = Delaunay(pixels).simplices
    except QhullError:  # all on one line
        return SurfaceSamples(pixels, np.zeros((0, 3), int))
    inside = [_depth_inside(outline, middle) > 0 for middle in pixels[triangles].mean(1)]
    return SurfaceSamples(pixels, triangles[inside])


def _depth_inside(outline: np.ndarray, point: np.ndarray) -> float:
    """How far a pixel position lies inside an outline; negative outside."""
    return cv2.pointPolygonTest(outline.astype(np.float32), (float(point[0]), float(point[1])), True)


def known_triangles(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles of which all corners are known at all times, int [M', 3]; positions float [K, T, 3]."""
    known = np.isfinite(positions).all((1, 2))
    return triangles[known[triangles].all(1)]


def surface_area(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Area of triangles int [M, 3] between points float [K, T, 3] at each time, float64 [T]."""
    return np.linalg.norm(_area_vectors(positions[triangles]), axis=-1).sum(0)


def swept_volume(positions: np.ndarray, triangles: np.ndarray, start: int) -> np.ndarray:
    """Signed volume between the surface at time `start` and at each time, float64 [T]: what it swept on the straight way there.

    It is positive on the side from which the triangles int [M, 3] look counter-clockwise. Exact for points float [K, T, 3] that go
    straight: over the way the mean displacement of a triangle is constant and its area vector quadratic, so Simpson's rule has no error.
    """
    there = positions[triangles]  # [M, 3, T, 3]
    here = there[:, :, start : start + 1]
    areas = (_area_vectors(here) + 4 * _area_vectors((here + there) / 2) + _area_vectors(there)) / 6
    return ((there - here).mean(1) * areas).sum((0, 2))


def facing(positions: np.ndarray, triangles: np.ndarray, eye: np.ndarray, start: int) -> np.ndarray:
    """The triangles int [M, 3], turned so that all look counter-clockwise from a place float [3] at time `start`."""
    corners = positions[triangles][:, :, start : start + 1]
    away = (_area_vectors(corners)[:, 0] * (eye - corners[:, :, 0].mean(1))).sum(-1) < 0
    return np.where(away[:, None], triangles[:, ::-1], triangles)


def _area_vectors(corners: np.ndarray) -> np.ndarray:
    """Normals of triangles float [M, 3, T, 3] with their areas as lengths, [M, T, 3]."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
