"""How uncertain depth is, where the error is known."""

import numpy as np
import pytest

from degense.engine.motion.depth_noise import depth_changes, depth_error

SHAPE = 48, 64
NO_FLOW = np.zeros((*SHAPE, 2), np.float32)


def plane(offset=0.0):
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return (1.0 + 0.002 * column + 0.001 * row + offset).astype(np.float32)


@pytest.mark.parametrize("sigma", [0.001, 0.01, 0.05])
def test_the_error_of_a_surface_that_comes_nearer_is_found(sigma):
    random = np.random.default_rng(4)
    frames = [plane(-0.03 * i) + sigma * random.standard_normal(SHAPE).astype(np.float32) for i in range(3)]
    assert depth_error(depth_changes(*frames, NO_FLOW, NO_FLOW)) == pytest.approx(sigma, rel=0.05)


def test_exact_depth_of_what_slides_has_no_error():
    ways = [np.full((*SHAPE, 2), way, np.float32) * [1, 0] for way in (-4.0, 4.0)]
    before, after = plane(0.008), plane(-0.008)  # what is at column x was at x − 4 and will be at x + 4
    changes = depth_changes(before, plane(), after, *(way.astype(np.float32) for way in ways))
    assert depth_error(changes) < 1e-6
    assert np.isnan(changes[:, :4]).all(), "it came from outside"
    assert np.isnan(changes[:, -4:]).all()


def test_holes_and_a_few_jumps_change_little():
    random = np.random.default_rng(5)
    frames = [plane() + 0.01 * random.standard_normal(SHAPE).astype(np.float32) for _ in range(3)]
    frames[0][:, :20] = 0
    frames[2][30:34] += 0.5
    assert depth_error(depth_changes(*frames, NO_FLOW, NO_FLOW)) == pytest.approx(0.01, rel=0.35)
    assert depth_error(np.full(SHAPE, np.nan)) == 0
