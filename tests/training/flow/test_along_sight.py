"""Motion along the line of sight, told by the noisy depth of all frames together."""

import numpy as np
import pytest
import torch

from degense.engine.training.flow.along_sight import low_rank, motion_along_sight
from degense.engine.training.flow.motion_error import motion_error
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from tests.fakes import MovingWall

CPU = torch.device("cpu")


def motion_of_cells(seed, frames=36, courses=2):
    """Smooth motion [frames − 1, 24, 30] since a first frame: so many courses over time, each strong in a part of the picture."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, frames)
    y, x = np.mgrid[0:24, 0:30]
    total = np.zeros((frames, 24, 30))
    for k in range(courses):
        course = np.sin(2 * np.pi * (rng.uniform(1, 4) * t + rng.uniform(0, 1)))
        where = np.exp(-((y - rng.uniform(0, 24)) ** 2 + (x - rng.uniform(0, 30)) ** 2) / (2 * rng.uniform(5, 10) ** 2))
        total += (1.0 - 0.3 * k) * course[:, None, None] * where
    return total[1:] - total[0]


@pytest.mark.parametrize("seed", range(4))
def test_motion_stands_out_of_noise_that_is_larger(seed):
    true, rng = motion_of_cells(seed), np.random.default_rng(100 + seed)
    noise = rng.normal(0, 0.5, (len(true) + 1, *true.shape[1:]))  # as large as the motion in the mean, or larger
    seen = true + noise[1:] - noise[0]
    seen[rng.uniform(size=seen.shape) < 0.2] = np.nan
    found = low_rank(seen)
    assert np.isfinite(found).all()
    error, before = (np.sqrt(np.nanmean((values - true) ** 2)) for values in (found, seen))
    assert error < 0.35 * before
    assert np.corrcoef(found.ravel(), true.ravel())[0, 1] > 0.85


@pytest.mark.parametrize("seed", range(4))
def test_noise_alone_moves_nothing(seed):
    noise = np.random.default_rng(seed).normal(0, 0.5, (37, 24, 30))
    assert not low_rank(noise[1:] - noise[0]).any()


def test_motion_without_noise_is_kept_and_completed():
    true = motion_of_cells(7, courses=1)
    seen = true.copy()
    seen[np.random.default_rng(8).uniform(size=seen.shape) < 0.2] = np.nan
    assert np.abs(low_rank(seen) - true).max() < 1e-3 * np.abs(true).max()


def test_what_is_seldom_known_or_a_clip_too_short_tells_nothing():
    true = motion_of_cells(3)
    seldom = true.copy()
    seldom[: 2 * len(seldom) // 3, 5, 6] = np.nan
    found = low_rank(seldom)
    assert np.isnan(found[:, 5, 6]).all()
    assert np.isfinite(found).sum() == found.size - len(found)
    assert np.isnan(low_rank(true[:2])).all()
    assert np.isnan(low_rank(np.full_like(true, np.nan))).all()


class Breathing(MovingWall):
    """A wall that comes and goes by a hundredth of its distance, whose depth errs by twice that."""

    def __init__(self, frames=30):
        super().__init__(frames, velocity=(0.0, 0.0, 0.0))

    def away(self, index):
        return 0.03 * np.sin(2 * np.pi * index / 12)

    def depth(self, index):
        depth = super().depth(index)
        return (depth + self.away(index) + np.random.default_rng(index).normal(0, 0.06, depth.shape)).astype(np.float32)


def supervision(clip):
    frames = TrainingFrames(clip, 1 << 20, CPU)
    return frames, FlowSupervision(frames)


def test_tissue_comes_and_goes_as_all_frames_say():
    clip = Breathing()
    frames, flow = supervision(clip)
    found = motion_along_sight(flow)
    first, *others = clip.train_frames
    assert not found[first].any()
    found = {i: gone.float().numpy() for i, gone in found.items()}
    true = np.array([clip.away(i) - clip.away(first) for i in others]) * frames.unit
    shown = np.array([np.median(found[i]) for i in others])
    assert np.corrcoef(shown, true)[0, 1] > 0.98
    assert np.abs(shown - true).max() < 0.25 * np.abs(true).max()
    for i in others:
        assert found[i].shape == flow.size[::-1]
        assert np.isfinite(found[i]).all()


def test_depth_that_can_be_trusted_or_is_not_measured_asks_no_other_frame():
    for measured in (True, False):
        flow = supervision(MovingWall(12, velocity=(0.0, 0.0, 0.02), measured=measured))[1]
        assert motion_along_sight(flow) == {}
        assert len(flow.inputs(0, flow.pairs[0][0])) == (8 if measured else 6)


def test_the_loss_on_motion_asks_for_what_all_frames_say():
    """With depth that cannot be trusted, points that move as told cost less than points that stay, and the gradient leads there."""
    clip = Breathing()
    frames, flow = supervision(clip)
    assert flow.depth_precision < 0.5
    flow.along_sight = motion_along_sight(flow)
    first, other = clip.train_frames[0], clip.train_frames[2]
    pair = flow.pair(first, other)
    random = np.random.default_rng(2).uniform(-0.7, 0.7, (200, 2))
    here = torch.from_numpy(np.c_[random, np.full(200, 3.0)] * frames.unit).float()
    told = float(flow.along_sight[other].float().median())
    assert abs(told) > 0.003

    def cost(step):
        there = here * (1 + step)  # along each point's own ray: nothing moves in the picture
        return float(motion_error(here, there, torch.ones(200), *flow.inputs(first, pair)))

    steps = np.linspace(-2 * abs(told), 2 * abs(told), 41)
    best = steps[np.argmin([cost(step) for step in steps])]
    assert abs(best - told) < 0.4 * abs(told)
    flow.along_sight = {}
    best = steps[np.argmin([cost(step) for step in steps])]
    assert abs(best) < 0.6 * abs(told), "without it the motion is shrunk towards nothing"


def test_the_loss_equals_its_float64_twin():
    rng = np.random.default_rng(5)
    clip = Breathing()
    frames, flow = supervision(clip)
    first, other = clip.train_frames[0], clip.train_frames[3]
    flow.along_sight = {i: torch.full(flow.size[::-1], value) for i, value in ((first, 0.0), (other, 0.013))}
    pair = flow.pair(first, other)
    here = torch.from_numpy(np.c_[rng.uniform(-0.5, 0.5, (50, 2)), np.full(50, 3.0)] * frames.unit).double()
    there = here + torch.from_numpy(rng.normal(0, 0.01, (50, 3)))
    inputs = flow.inputs(first, pair)
    single = motion_error(here.float(), there.float(), torch.ones(50), *inputs)
    double = motion_error(here, there, torch.ones(50).double(), *(x.double() for x in inputs))
    assert single == pytest.approx(float(double), rel=2e-3)
