"""Specks and holes, by hand-made pictures."""

import numpy as np

from degense.engine.semantics.masks.cleaning import without_holes, without_specks


def disc(height=100, width=100, radius=40):
    y, x = np.mgrid[:height, :width]
    return (y - 50) ** 2 + (x - 50) ** 2 < radius**2


def test_specks_go_unless_they_are_all_there_is():
    mask = np.zeros((400, 400), bool)
    mask[10:12, 10:12] = True
    np.testing.assert_array_equal(without_specks(mask), mask)
    mask[100:150, 100:150] = True
    expected = mask.copy()
    expected[10:12, 10:12] = False
    np.testing.assert_array_equal(without_specks(mask), expected)
    assert not without_specks(np.zeros((5, 5), bool)).any()
    assert not without_specks(mask, 0.02).any(), "what is too small to be believed goes, were it all there is"
    np.testing.assert_array_equal(without_specks(mask, 0.015), expected)


def test_holes_close_by_what_they_show():
    mask = disc()
    mask[45:50, 45:50] = False
    hole = disc() & ~mask
    similar, foreign = np.where(hole, 0.4, 1.0), np.where(hole, 0.1, 1.0)
    np.testing.assert_array_equal(without_holes(mask, similar, 0.5), disc())
    np.testing.assert_array_equal(without_holes(mask, foreign, 0.5), mask)
    # an instrument in front of the organ: similarity is not low, but another class fits better
    np.testing.assert_array_equal(without_holes(mask, similar, 0.5, rivals=np.where(hole, 0.8, 0.0)), mask)
    np.testing.assert_array_equal(without_holes(mask, similar, 0.5, rivals=np.where(hole, 0.2, 0.0)), disc())


def test_tiny_holes_always_close_and_large_ones_never():
    mask = np.ones((300, 300), bool)
    mask[50:52, 50:52] = False
    mask[100:140, 100:140] = False
    closed = without_holes(mask, np.where(mask, 1.0, np.where(np.arange(300) < 60, 0.0, 0.45)), 0.5)
    assert closed[50:52, 50:52].all()
    assert not closed[100:140, 100:140].any()


def test_bays_open_to_the_edge_are_no_holes():
    mask = np.ones((50, 50), bool)
    mask[20:24, :5] = False
    np.testing.assert_array_equal(without_holes(mask, np.ones((50, 50)), 0.5), mask)


def test_a_hole_touching_only_by_its_corner_is_enclosed():
    mask = np.ones((300, 300), bool)
    for i in range(20):
        mask[10 + i, 10 + i] = False
    assert without_holes(mask, np.ones((300, 300)), 0.5).all()
