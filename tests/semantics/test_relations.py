"""Relations between drawn shapes, where a person would say so; gaps and holes against slow definitions."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.semantics.relations import CONTACT, NEAR, extreme, related

SIZE = 120, 160  # a diagonal of 200 pixels: contact up to 1 pixel, near up to 20


def box(*places: tuple[int, int, int, int]) -> np.ndarray:
    """Rectangles (x, y, width, height)."""
    mask = np.zeros(SIZE, bool)
    for x, y, width, height in places:
        mask[y : y + height, x : x + width] = True
    return mask


LEFT, RIGHT, TOP, BOTTOM = (10, 50, 20, 20), (130, 50, 20, 20), (70, 5, 20, 20), (70, 95, 20, 20)
MIDDLE = box((70, 50, 20, 20))


@pytest.mark.parametrize(("relation", "place"), [("left of", LEFT), ("right of", RIGHT), ("above", TOP), ("below", BOTTOM)])
def test_each_object_is_asked_for_itself(relation, place):
    found = related(box(LEFT, RIGHT, TOP, BOTTOM), relation, MIDDLE)
    np.testing.assert_array_equal(found, box(place))
    others = related(box(LEFT, RIGHT, TOP, BOTTOM), relation, MIDDLE, negated=True)
    np.testing.assert_array_equal(others, box(LEFT, RIGHT, TOP, BOTTOM) & ~box(place))


def test_on_a_diagonal_both_hold_and_far_off_one_does_not():
    diagonal = box((20, 0, 20, 20))
    assert related(diagonal, "left of", MIDDLE).any()
    assert related(diagonal, "above", MIDDLE).any()
    high = box((55, 0, 20, 20))  # 15 pixels to the left, 50 above
    assert related(high, "above", MIDDLE).any()
    assert not related(high, "left of", MIDDLE).any()


def test_gaps_are_those_between_the_nearest_pixels():
    rng = np.random.default_rng(3)
    for _ in range(10):
        mask, other = (np.zeros(SIZE, bool) for _ in range(2))
        for target in (mask, other):
            x, y = rng.integers(0, 100, 2)
            target[y : y + 12, x : x + 20] = rng.random((min(12, SIZE[0] - y), 20)) < 0.9
        biggest = extreme(mask, True)
        gap = np.linalg.norm(np.argwhere(biggest)[:, None] - np.argwhere(other)[None], axis=2).min() - 1
        for relation, share in (("touching", CONTACT), ("near", NEAR)):
            assert related(biggest, relation, other).any() == (gap <= share * 200), (relation, gap)


def test_contact_forgives_the_uncertainty_of_an_outline_and_no_more():
    assert related(box((49, 50, 20, 20)), "touching", MIDDLE).any()  # one pixel between
    assert not related(box((48, 50, 20, 20)), "touching", MIDDLE).any()
    assert related(box((48, 50, 20, 20)), "near", MIDDLE).any()


def test_inside_is_in_the_other_or_in_its_holes():
    ring = box((40, 20, 80, 80)) & ~box((60, 40, 40, 40))
    np.testing.assert_array_equal(related(box((70, 50, 10, 10), (0, 0, 10, 10)), "inside", ring), box((70, 50, 10, 10)))
    open_ring = ring & ~box((40, 55, 20, 10))
    assert not related(box((70, 50, 10, 10)), "inside", open_ring).any()
    assert related(box((100, 50, 30, 10)), "inside", ring).any()  # two thirds of it
    assert not related(box((110, 50, 30, 10)), "inside", ring).any()


def test_between_is_what_the_others_span():
    found = related(box(LEFT, (70, 50, 20, 20), TOP), "between", box((40, 50, 10, 20), RIGHT))
    np.testing.assert_array_equal(found, MIDDLE)


def test_the_largest_and_the_smallest_object():
    mask = box((0, 0, 10, 10), (50, 50, 30, 30), (100, 0, 5, 5))
    np.testing.assert_array_equal(extreme(mask, True), box((50, 50, 30, 30)))
    np.testing.assert_array_equal(extreme(mask, False), box((100, 0, 5, 5)))


@pytest.mark.parametrize("relation", ["left of", "touching", "near", "inside", "between"])
def test_nothing_stands_in_a_relation_to_nothing(relation):
    nothing = np.zeros(SIZE, bool)
    assert not related(MIDDLE, relation, nothing).any()
    np.testing.assert_array_equal(related(MIDDLE, relation, nothing, negated=True), MIDDLE)
    assert not related(nothing, relation, MIDDLE).any()
    assert not related(nothing, relation, MIDDLE, negated=True).any()
    assert not extreme(nothing, True).any()
