"""Points followed through frames by small windows, on a texture whose motion is known."""

import numpy as np

from degense.engine.motion.matched import matching
from degense.engine.progress import finish
from tests.motion.test_points import FRAMES, sliding


def followed(queries):
    still = np.repeat(queries[:, None, 1:], FRAMES, axis=1)
    return finish(matching(sliding, still, queries))


def test_points_are_where_they_slide_to_both_ways():
    queries = np.array([[0, 40.0, 45.0], [3, 40.0, 50.0]])
    found = followed(queries)
    for k, (start, x, y) in enumerate(queries):
        right = np.array([[x + 2 * (t - start), y + (t - start)] for t in range(5)])
        np.testing.assert_allclose(found.pixels[k, :5], right, atol=0.3)
        assert (found.unlike[k, :5] < 4).all()
        far = np.abs(np.arange(5) - start) >= 2
        assert (found.guessed_unlike[k, :5][far] > 2 * found.unlike[k, :5][far]).all(), "it does not stay where it was"
        assert found.unlike[k, int(start)] == 0
        np.testing.assert_allclose(found.guessed_unlike[k, int(start)], 0, atol=1e-3)


def test_a_point_that_is_covered_is_lost_for_good():
    found = followed(np.array([[0, 90.0, 40.0]]))
    assert np.isfinite(found.unlike[0, :5]).all()
    assert np.isnan(found.pixels[0, 5:]).all()
    assert np.isnan(found.unlike[0, 5:]).all()
    assert np.isfinite(found.guessed_unlike[0]).all()


def test_where_nothing_is_guessed_nothing_is_said_of_the_guess():
    queries = np.array([[3, 40.0, 50.0]])
    found = finish(matching(sliding, np.full((1, FRAMES, 2), np.nan), queries))
    assert np.isnan(found.guessed_unlike).all()
    assert np.isfinite(found.pixels[0, :5]).all()


def test_no_points_are_no_work():
    assert followed(np.zeros((0, 3))).pixels.shape == (0, FRAMES, 2)
