"""Lengths, areas and volumes are those of bodies whose sizes are known."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.scene.measures import cover, facing, known_triangles, path_length, surface_area, swept_volume

L_SHAPE = np.array([[10, 10], [70, 10], [70, 30], [30, 30], [30, 90], [10, 90]], float)


def lifted(pixels: np.ndarray, *heights) -> np.ndarray:
    """Points at (x, y, z) for each height: a number, or a function of x and y; [K, T, 3]."""
    planes = [height(*pixels.T) if callable(height) else np.full(len(pixels), float(height)) for height in heights]
    return np.stack([np.column_stack([pixels, plane]) for plane in planes], 1)


def test_lengths():
    line = np.array([[[0, 0, 0], [0, 0, 0]], [[3, 4, 0], [6, 8, 0]], [[3, 4, 5], [6, 8, 0]]], float)
    assert path_length(line[:2]) == pytest.approx([5, 10])
    assert path_length(line) == pytest.approx([10, 10])


@pytest.mark.parametrize("outline", [L_SHAPE, L_SHAPE[::-1], np.array([[0, 0], [50, 0], [20, 40]], float)])
def test_area_of_a_flat_outline(outline):
    x, y = outline.T
    exact = abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
    samples = cover(outline)
    assert 50 < len(samples.pixels) < 400
    areas = surface_area(lifted(samples.pixels, 0, lambda x, y: 0.75 * x), samples.triangles)
    assert areas == pytest.approx([exact, exact * 1.25], rel=1e-6)  # a slope of 3 in 4 stretches to 5 in 4


def test_area_of_a_sphere_cap():
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    outline = 60 * np.stack([np.cos(angles), np.sin(angles)], 1)
    samples = cover(outline, 600)
    cap = surface_area(lifted(samples.pixels, lambda x, y: np.sqrt(100**2 - x**2 - y**2)), samples.triangles)
    assert cap[0] == pytest.approx(2 * np.pi * 100 * (100 - 80), rel=0.01)


def test_volume_of_a_plate_that_rises_and_of_a_dome():
    samples = cover(L_SHAPE)
    area = surface_area(lifted(samples.pixels, 0), samples.triangles)[0]
    positions = lifted(samples.pixels, 0, 5, -2)
    turned = facing(positions, samples.triangles, np.array([40.0, 40.0, 1000.0]), 0)
    assert swept_volume(positions, turned, 0) == pytest.approx([0, 5 * area, -2 * area])
    assert swept_volume(positions, turned, 1) == pytest.approx([-5 * area, 0, -7 * area])
    below = facing(positions, samples.triangles, np.array([40.0, 40.0, -1000.0]), 0)
    assert swept_volume(positions, below, 0) == pytest.approx([0, -5 * area, 2 * area])


def test_volume_of_a_cube_that_grows_from_a_point():
    """Points that go straight from the middle of a cube to its side sweep a sixth of it."""
    side = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], float)
    positions = np.stack([np.zeros_like(side), side], 1)
    assert swept_volume(positions, np.array([[0, 1, 2], [0, 2, 3]]), 0) == pytest.approx([0, 8 / 6])


def test_what_is_not_known_is_left_out():
    samples = cover(L_SHAPE)
    positions = lifted(samples.pixels, 0, 1)
    positions[0, 1] = np.nan
    some = known_triangles(positions, samples.triangles)
    assert 0 < len(some) < len(samples.triangles)
    assert not (some == 0).any()
    assert np.isfinite(surface_area(positions, some)).all()
    assert len(cover(np.array([[0, 0], [10, 0], [20, 0]], float)).triangles) == 0
