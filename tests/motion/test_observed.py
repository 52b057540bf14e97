"""Motion that the recording shows, against a wall whose motion is known."""

import numpy as np
import pytest

from degense.engine.motion import flow_between
from degense.engine.motion import observed as module
from degense.engine.motion.observed import ObservedMotion, with_own
from degense.engine.motion.surroundings import Shares, from_around
from tests.fakes import CharringWall, MovingWall


@pytest.mark.parametrize(("reference", "seed"), [(0, 0), (2, 1)])
def test_it_follows_a_sliding_texture(reference, seed):
    clip = MovingWall(8, velocity=(0.06, 0.03, 0.0), seed=seed)
    motion = ObservedMotion(clip, reference)
    for frame in range(reference, 8):
        flow, believed, spread = motion.at(frame)
        assert flow.shape == (72, 96, 2)
        assert flow.dtype == np.float32
        assert believed.shape == (72, 96)
        assert believed.dtype == bool
        assert (spread[believed] == 0).all()
        assert believed.mean() > 0.6
        error = np.linalg.norm(flow - clip.flow(frame, reference), axis=-1)[believed]
        assert np.median(error) < 0.6  # evening out the contrast of a frame as small as this costs a third of a pixel
        assert np.quantile(error, 0.98) < 2
    assert np.linalg.norm(clip.flow(7, reference), axis=-1).min() > 8  # there was something to follow


def test_it_follows_a_wall_that_comes_nearer():
    clip = MovingWall(7, velocity=(0.0, 0.0, -0.08))
    flow, believed, _ = ObservedMotion(clip, 0).at(6)
    error = np.linalg.norm(flow - clip.flow(6, 0), axis=-1)
    assert believed.mean() > 0.5
    assert np.median(error[believed]) < 0.8
    assert np.linalg.norm(clip.flow(6, 0), axis=-1).mean() > 4


def test_large_frames_are_measured_small_and_told_large(monkeypatch):
    monkeypatch.setattr(module, "PIXELS", 96 * 72)
    clip = MovingWall(4, 192, 144, velocity=(0.06, 0.03, 0.0))
    motion = ObservedMotion(clip, 0)
    assert motion.size == (96, 72)
    flow, believed, _ = motion.at(3)
    assert flow.shape == (144, 192, 2)
    error = np.linalg.norm(flow - clip.flow(3, 0), axis=-1)
    assert believed.mean() > 0.6
    assert np.median(error[believed]) < 1.2  # twice the small frame's


@pytest.mark.parametrize(
    ("large", "small"), [((320, 256), (320, 256)), ((640, 512), (320, 256)), ((854, 480), (427, 240)), ((96, 72), (96, 72))]
)
def test_frames_are_made_smaller_by_whole_factors(large, small):
    assert ObservedMotion(MovingWall(1, *large), 0).size == small


def test_it_is_believed_only_where_both_ends_are_valid_and_inside():
    hole = np.s_[20:44, 36:60]
    clip = MovingWall(6, velocity=(0.08, 0.0, 0.0), hole=hole)
    motion = ObservedMotion(clip, 0)
    for frame in (1, 3, 5):
        _, believed, spread = motion.at(frame)
        assert np.isnan(spread[hole]).all()
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

    _, believed, _ = ObservedMotion(Plain(4), 0).at(3)
    assert believed.mean() < 0.05


def test_nothing_is_known_before_the_reference():
    flow, believed, spread = ObservedMotion(MovingWall(6), 3).at(1)
    assert not believed.any()
    assert np.isnan(spread).all()
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


def test_own_flow_and_the_motion_around_are_weighed_by_their_precisions():
    around, flow = np.full((2, 3, 2), 4, np.float32), np.zeros((2, 3, 2), np.float32)
    spread = np.array([[1, 1, np.nan], [2, 0, np.nan]], np.float32)
    error = np.array([[1, np.nan, 0.5], [0.2, np.nan, np.nan]], np.float32)
    mean, left = with_own(around, spread, flow, error)
    for y, x in np.ndindex(2, 3):
        own, other = error[y, x] ** 2 + 0.01, spread[y, x] ** 2 + 0.01  # variances
        if np.isnan(own):
            expected = 4.0, spread[y, x]
        elif np.isnan(other):
            expected = 0.0, own**0.5
        else:
            expected = 4 * own / (own + other), (own * other / (own + other)) ** 0.5
        np.testing.assert_allclose(mean[y, x], expected[0], rtol=1e-5)
        np.testing.assert_allclose(left[y, x], expected[1], rtol=1e-5)


def test_what_is_not_seen_has_the_mean_and_the_spread_of_what_is_seen_around():
    rng = np.random.default_rng(4)
    flow = np.full((60, 80, 2), (2.0, -1.0), np.float32)
    flow[:, 40:] = (6.0, -1.0)
    seen = np.ones((60, 80), bool)
    inside, between = np.s_[28:32, 18:22], np.s_[28:32, 38:42]
    seen[inside] = seen[between] = False
    found, spread = from_around(np.where(seen[..., None], flow, rng.normal(0, 50, flow.shape)), seen)
    assert (spread[seen] == 0).all()
    assert np.array_equal(found[seen], flow[seen])
    np.testing.assert_allclose(found[inside], flow[inside], atol=0.05)
    assert spread[inside].max() < 0.2
    assert np.all((found[between][..., 0] > 2.2) & (found[between][..., 0] < 5.8))
    assert np.all((spread[between] > 0.8) & (spread[between] < 2.1))  # two populations, 4 apart: 2 in the middle
    seen[:, 5:] = False
    found, spread = from_around(flow, seen)
    assert np.isnan(spread[:, 60:]).all()
    assert np.isfinite(spread[:, :8]).all()
    assert np.isnan(from_around(flow, np.zeros_like(seen))[1]).all()


def test_what_is_not_seen_goes_on_as_what_is_seen_around_changes():
    """Against weighted least squares, pixel by pixel and in float64, with the window and the ridge of the docstring."""
    rng = np.random.default_rng(7)
    height, width = 96, 128
    y, x = np.mgrid[:height, :width] / width
    flow = np.dstack([9 * x - 4 * y + np.sin(9 * x * y), 5 * y + np.cos(7 * x)]) + rng.normal(0, 0.2, (height, width, 2))
    flow = flow.astype(np.float32)
    seen = rng.random((height, width)) < 0.8
    seen[30:60, 40:70] = seen[:, 115:] = False
    found, spread = from_around(flow, seen)
    unseen_away, _ = from_around(np.where(seen[..., None], flow, 0), seen)
    np.testing.assert_array_equal(found, unseen_away)
    for row, column in ((45, 55), (33, 45), (58, 68), (40, 122), (80, 118), (45, 42)):
        squared = (x - x[row, column]) ** 2 + (y - y[row, column]) ** 2
        for reach in (0.02, 0.06, 0.18):
            weight = np.exp(-squared / (2 * reach**2)) * seen
            share = weight.sum() / (2 * np.pi * (reach * width) ** 2)
            if share > 0.1:
                break
        places, values, weights = np.stack([x[seen], y[seen]], -1), flow[seen].astype(float), weight[seen] / weight.sum()
        off, mean = places - weights @ places, weights @ values
        inverse = np.linalg.inv((off.T * weights) @ off + 0.3 * reach**2 * np.eye(2))
        slope = inverse @ ((off.T * weights) @ (values - mean))
        here = np.array([x[row, column], y[row, column]]) - weights @ places
        left = weights @ np.square(values - mean - off @ slope).sum(-1)
        np.testing.assert_allclose(found[row, column], mean + here @ slope, atol=0.06)
        np.testing.assert_allclose(spread[row, column], np.sqrt(left * (1 + here @ inverse @ here)), rtol=0.1)


PATCH, INSIDE = np.s_[16:44, 28:52], np.s_[24:36, 34:46]


STEADY = np.linspace(0.7, 1.3, 80)  # of the breathing: more to the right
UNEVEN = 1 + 0.2 * np.kron(np.random.default_rng(3).normal(size=(15, 20)), np.ones((4, 4)))  # from cell to cell


def breathing(phases, still, own=lambda number: 0.0, before=None, around=STEADY):
    """`Shares` of tissue that breathes by phases in pixels; a patch has the share `still` of that, and an own motion.

    In the last frame it is hidden.
    """
    shares = before or Shares()
    for number, phase in enumerate(phases, start=1):
        out, seen = np.zeros((60, 80, 2), np.float32), np.ones((60, 80), bool)
        out[..., 0] = phase * around
        out[PATCH] = still * np.array([phase, 0]) + np.array([0, own(number)])
        if number == len(phases):
            seen[PATCH] = False
            out[PATCH] = 50  # what flow makes of blood
        shares.add(out, seen, seen)
    return shares


AT_REST = np.zeros((60, 80, 2), np.float32)


@pytest.mark.parametrize("still", [0.0, 0.5, 1.0, 1.4])
def test_a_hidden_place_keeps_the_share_of_the_motion_around_that_it_had(still):
    share, _ = breathing((3, 5, -4, 6, 4, 5, -6, 5), still).of(8, AT_REST)
    np.testing.assert_allclose(share[INSIDE], still, rtol=0.1, atol=0.02)  # what is around grows to the right, the patch's motion does not


def test_what_was_never_shown_moves_as_what_is_around_and_little_motion_tells_little():
    for phases in ((5,), (0.02, 0.03, 5)):
        share, part = breathing(phases, 0.0).of(len(phases), AT_REST)
        np.testing.assert_allclose(share[INSIDE], 1, atol=0.01)
        np.testing.assert_allclose(part[INSIDE], 1, atol=0.01)


def test_a_place_that_kept_to_its_share_has_less_of_the_spread_than_one_with_a_motion_of_its_own():
    phases = (9, 15, -12, 18, 12, 15, -18, 15)
    kept = breathing(phases, 0.5, around=UNEVEN).of(8, AT_REST)[1][INSIDE]
    wandered = breathing(phases, 0.5, own=lambda number: 6 * (-1) ** number, around=UNEVEN).of(8, AT_REST)[1][INSIDE]
    assert kept.max() < 0.6
    assert wandered.min() > 0.9


def test_shares_are_of_the_frames_before_and_looked_up_where_a_place_was():
    shares = breathing((3, 5, -4, 6), 0.0)
    before = shares.of(4, AT_REST)
    shifted = shares.of(4, np.full_like(AT_REST, (20, 0)))
    np.testing.assert_allclose(shifted[0][:, :60], before[0][:, 20:], atol=1e-5)
    assert (shifted[0][:, 61:] == 1).all()  # outside
    breathing((4, 5, 6, 7), 1.0, before=shares)
    for earlier, now in zip(before, shares.of(4, AT_REST), strict=True):
        np.testing.assert_array_equal(earlier, now)


def test_what_stood_still_stands_still_under_blood():
    class Bleeding(MovingWall):
        """The wall slides behind a round window through which tissue is seen that stands still, and bleeds in the last frame."""

        def frame(self, index):
            y, x = np.mgrid[:144, :192]
            inside = np.hypot(x - 96, y - 72) < 26
            image = np.where(inside[..., None], super().frame(0), super().frame(index))
            if index == len(self) - 1:
                blood = np.random.default_rng(index).normal((150, 10, 10), 6, image.shape).clip(0, 255)
                image = np.where(inside[..., None], blood, image)
            return image.astype(np.uint8)

    clip = Bleeding(8, 192, 144, velocity=(0.03, 0.0, 0.0))
    flow, seen, _ = ObservedMotion(clip, 0).at(7)
    middle = np.s_[62:82, 86:106]
    around = np.linalg.norm(clip.flow(7, 0), axis=-1)[middle]
    assert around.min() > 8
    assert seen[middle].mean() < 0.1
    assert np.linalg.norm(flow[middle], axis=-1).mean() < 0.1 * around.min()


def test_a_burn_has_the_motion_of_what_is_around_it():
    clip = CharringWall(velocity=(0.0, 0.0, 0.0))
    last = len(clip) - 1
    flow, seen, spread = ObservedMotion(clip, 0).at(last)
    spot = np.s_[30:42, 42:54]
    assert seen[spot].mean() < 0.05
    assert np.isfinite(spread[spot]).all()
    assert np.linalg.norm(flow[spot], axis=-1).max() < 0.3
    trusted = flow_between(clip.frame(last), clip.frame(0))
    assert np.linalg.norm(trusted[spot], axis=-1).max() > 1  # optical flow alone takes the spot's growth for motion
