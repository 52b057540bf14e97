"""Motion that the recording shows, against a wall whose motion is known."""

import numpy as np
import pytest

from degense.engine.motion import observed as module
from degense.engine.motion.observed import ObservedMotion
from tests.fakes import MovingWall


@pytest.mark.parametrize(("reference", "seed"), [(0, 0), (2, 1)])
def test_it_follows_a_sliding_texture(reference, seed):
    clip = MovingWall(8, velocity=(0.06, 0.03, 0.0), seed=seed)
    motion = ObservedMotion(clip, reference)
    for frame in range(reference, 8):
        flow, believed = motion.at(frame)
        assert flow.shape == (72, 96, 2)
        assert flow.dtype == np.float32
        assert believed.shape == (72, 96)
        assert believed.dtype == bool
        assert believed.mean() > 0.6
        error = np.linalg.norm(flow - clip.flow(frame, reference), axis=-1)[believed]
        assert np.median(error) < 0.6  # evening out the contrast of a frame as small as this costs a third of a pixel
        assert np.quantile(error, 0.98) < 2
    assert np.linalg.norm(clip.flow(7, reference), axis=-1).min() > 8  # there was something to follow


def test_it_follows_a_wall_that_comes_nearer():
    clip = MovingWall(7, velocity=(0.0, 0.0, -0.08))
    flow, believed = ObservedMotion(clip, 0).at(6)
    error = np.linalg.norm(flow - clip.flow(6, 0), axis=-1)
    assert believed.mean() > 0.5
    assert np.median(error[believed]) < 0.8
    assert np.linalg.norm(clip.flow(6, 0), axis=-1).mean() > 4


def test_large_frames_are_measured_small_and_told_large(monkeypatch):
    monkeypatch.setattr(module, "PIXELS", 96 * 72)
    clip = MovingWall(4, 192, 144, velocity=(0.06, 0.03, 0.0))
    motion = ObservedMotion(clip, 0)
    assert motion.size == (96, 72)
    flow, believed = motion.at(3)
    assert flow.shape == (144, 192, 2)
    error = np.linalg.norm(flow - clip.flow(3, 0), axis=-1)
    assert believed.mean() > 0.6
    assert np.median(error[believed]) < 1.2  # twice the small frame's


def test_it_is_believed_only_where_both_ends_are_valid_and_inside():
    hole = np.s_[20:44, 36:60]
    clip = MovingWall(6, velocity=(0.08, 0.0, 0.0), hole=hole)
    motion = ObservedMotion(clip, 0)
    for frame in (1, 3, 5):
        _, believed = motion.at(frame)
        truth = clip.flow(frame, 0)
        y, x = np.indices(believed.shape)
        column = x + truth[..., 0]
        assert not believed[hole].any()
        arrives_in_hole = (y >= 21) & (y < 43) & (column > 37) & (column < 58)  # a pixel from its rim, since flow is not exact
        assert arrives_in_hole.any()
        leaves = column < -1
        assert not (believed & arrives_in_hole).any()
        assert leaves.any()
        assert (believed & leaves).sum() <= 0.05 * leaves.sum()
    assert np.array_equal(motion.at(0)[1], clip.valid(0))


def test_a_plain_wall_shows_nothing():
    class Plain(MovingWall):
        def frame(self, index):
            noise = np.random.default_rng(index).normal(0, 1, (72, 96, 3))
            return (128 + noise).round().astype(np.uint8)

    _, believed = ObservedMotion(Plain(4), 0).at(3)
    assert believed.mean() < 0.05


def test_nothing_is_known_before_the_reference():
    flow, believed = ObservedMotion(MovingWall(6), 3).at(1)
    assert not believed.any()
    assert (flow == 0).all()


def test_frames_may_be_asked_for_in_any_order_and_are_read_once():
    class Counting(MovingWall):
        read = 0

        def frame(self, index):
            self.read += 1
            return super().frame(index)

    clip = Counting(7)
    motion = ObservedMotion(clip, 0)
    late, before = motion.at(5), clip.read
    early = motion.at(2)
    assert clip.read == before
    fresh = ObservedMotion(MovingWall(7), 0)
    for a, b in zip((*fresh.at(2), *fresh.at(5)), (*early, *late), strict=True):
        np.testing.assert_array_equal(a, b)
