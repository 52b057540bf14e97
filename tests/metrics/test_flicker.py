"""Flicker by hand, on label maps of a few pixels."""

import numpy as np
import pytest

from degense.engine.metrics.flicker import Flicker, warped


def still(shape):
    return np.zeros((*shape, 2), np.float32), np.ones(shape, bool)


def test_what_changes_without_reason_is_counted():
    before, now = np.uint8([[0, 0, 1, 1]]), np.uint8([[0, 1, 1, 255]])
    flicker = Flicker()
    flicker.add(before, now, *still(before.shape))
    assert (flicker.changed, flicker.counted, flicker.value) == (2, 4, 0.5)
    flicker.add(now, now, *still(before.shape))
    assert flicker.value == 0.25, "pixels of all pairs count alike"
    assert Flicker().value is None


def test_what_moves_along_does_not_flicker():
    """A block of class 1 two pixels to the right: flow from now to before is −2 in x."""
    before, now = np.zeros((6, 8), np.uint8), np.zeros((6, 8), np.uint8)
    before[2:4, 1:4], now[2:4, 3:6] = 1, 1
    flow, sure = still(before.shape)
    flow[..., 0] = -2
    flicker = Flicker()
    flicker.add(before, now, flow, sure)
    assert flicker.value == 0.0
    assert flicker.counted == 6 * 6, "two columns come from outside the picture"
    stayed = Flicker()
    stayed.add(before, before, flow, sure)
    assert stayed.changed == 6, "what does not follow the tissue lacks two columns and has one too many, beside one that does not count"


def test_true_changes_and_unknown_pixels_do_not_count():
    before, now = np.uint8([[0, 0, 0, 0]]), np.uint8([[1, 1, 0, 1]])
    true_before, true_now = np.uint8([[0, 0, 0, 255]]), np.uint8([[1, 0, 0, 255]])
    flow, sure = still(before.shape)
    flicker = Flicker()
    flicker.add(before, now, flow, sure, true_before, true_now)
    assert (flicker.changed, flicker.counted) == (1, 2)
    sure[0, 1] = False
    again = Flicker()
    again.add(before, now, flow, sure, true_before, true_now)
    assert (again.changed, again.counted) == (0, 1)


def test_carried_takes_the_nearest_pixel():
    labels, flow = np.uint8([[3, 4, 5]]), np.zeros((1, 3, 2), np.float32)
    flow[0, :, 0] = (0.4, 0.6, 0.6)
    found, inside = warped(labels, flow)
    assert found[0, :2].tolist() == [3, 5]
    assert inside.tolist() == [[True, True, False]]
    flow[0, 0] = np.nan
    assert not warped(labels, flow)[1][0, 0]


def test_an_exact_translation_by_brute_force():
    rng = np.random.default_rng(0)
    before, now = (rng.integers(0, 3, (7, 9)).astype(np.uint8) for _ in range(2))
    flow = np.rint(rng.uniform(-2, 2, (7, 9, 2))).astype(np.float32)
    sure = rng.random((7, 9)) < 0.7
    changed = counted = 0
    for y, x in np.ndindex(now.shape):
        i, j = x + int(flow[y, x, 0]), y + int(flow[y, x, 1])
        if sure[y, x] and 0 <= i < 9 and 0 <= j < 7:
            counted += 1
            changed += now[y, x] != before[j, i]
    flicker = Flicker()
    flicker.add(before, now, flow, sure)
    assert flicker.value == pytest.approx(changed / counted)
