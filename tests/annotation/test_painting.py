"""What strokes cover."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from degense.engine.annotation.painting import brush, fill, holes, polygon, smaller_islands, whole_regions

SHAPE = (20, 30)


def full(region) -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    if region is not None:
        mask[region.box] = region.mask
    return mask


@given(*[st.floats(-8, 38) for _ in range(4)], st.floats(0.5, 9))
def test_a_brush_covers_what_lies_within_its_radius(ax, ay, bx, by, radius):
    mask = full(brush((ax, ay), (bx, by), radius, SHAPE))
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]] + 0.5
    line = np.linspace([ax, ay], [bx, by], 400)
    distance = np.sqrt(((np.stack([x, y], -1)[:, :, None] - line) ** 2).sum(-1)).min(-1)
    assert mask[distance < radius - 0.1].all()
    assert not mask[distance > max(radius, 0.75) + 0.1].any()  # the pixel under the pointer always counts


def test_the_finest_brush_paints_the_pixel_under_it():
    assert np.argwhere(full(brush((7.9, 3.1), (7.9, 3.1), 0.4, SHAPE))).tolist() == [[3, 7]]
    assert brush((-9, -9), (-9, -9), 2, SHAPE) is None


def test_a_polygon_is_its_inside():
    mask = full(polygon([(5, 4), (15, 4), (15, 12), (5, 12)], SHAPE))
    assert mask[5:11, 6:14].all()
    assert mask.sum() <= 11 * 9
    assert polygon([(5, 4), (15, 4)], SHAPE) is None
    assert full(polygon([(-1e9, -1e9), (1e9, -1e9), (1e9, 1e9), (-1e9, 1e9)], SHAPE)).all()


def test_filling_stops_at_other_labels():
    labels = np.zeros(SHAPE, np.uint8)
    labels[:, 10] = 3
    region = fill(labels, (4, 4))
    assert full(region).sum() == 10 * SHAPE[0]
    assert not full(region)[:, 10:].any()
    assert fill(labels, (30, 4)) is None
    assert labels.max() == 3  # the labels themselves stay


def test_superpixels_are_painted_whole():
    regions = np.arange(6, dtype=np.int32).repeat(5)[None].repeat(20, 0)
    mask = full(whole_regions(regions, brush((6, 3), (12, 3), 0.5, SHAPE)))
    assert mask[:, 5:15].all()
    assert mask.sum() == 10 * 20


def test_holes_and_islands():
    labels = np.full(SHAPE, 255, np.uint8)
    labels[2:12, 2:12] = 1
    labels[5:7, 5:8] = 0
    labels[15:17, 20:22] = 1
    labels[0:3, 0:1] = 1
    assert full(holes(labels, 1)).sum() == 6
    large = np.zeros(SHAPE, bool)
    large[2:12, 2:12] = True
    assert np.array_equal(full(smaller_islands(labels, 1)), (labels == 1) & ~large)
    assert smaller_islands(labels, 0) is None
    assert holes(labels, 7) is None


@pytest.mark.parametrize("points", [[], [(1, 1)], [(1, 1), (2, 2)]])
def test_fewer_than_three_corners_enclose_nothing(points):
    assert polygon(points, SHAPE) is None
