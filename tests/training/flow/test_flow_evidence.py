"""Where optical flow counts as evidence of motion, and how much."""

import numpy as np
import pytest
import torch

from degense.engine.training.flow.motion_error import motion_error
from degense.engine.training.flow.supervision import LEAST_ERROR, FlowSupervision, precision_of
from degense.engine.training.frames import TrainingFrames
from tests.fakes import CharringWall, MovingWall

CPU = torch.device("cpu")


def test_flow_is_no_evidence_where_tissue_changes_its_look():
    clip = CharringWall(velocity=(0.0, 0.0, 0.0))
    frames = TrainingFrames(clip, 1 << 20, CPU)
    strict, trusting = FlowSupervision(frames), FlowSupervision(frames, constancy=False)
    width, height = strict.size
    spot, corner = np.s_[height // 2 - 3 : height // 2 + 3, width // 2 - 3 : width // 2 + 3], np.s_[: height // 5, : width // 5]

    def kept(flow, where):
        return np.mean([float(pair.weight[0][where].float().mean()) for pairs in flow.pairs.values() for pair in pairs])

    assert kept(trusting, spot) > 0.3
    assert kept(strict, spot) < 0.05
    assert kept(strict, corner) > 0.9 * kept(trusting, corner) > 0.5


class PlainerWall(MovingWall):
    """A wall whose right half has hardly any texture, seen by a camera that has noise."""

    def frame(self, index):
        rgb = super().frame(index).astype(float)
        rgb[:, rgb.shape[1] // 2 :] = 120 + 0.05 * (rgb[:, rgb.shape[1] // 2 :] - 120)
        return np.clip(rgb + np.random.default_rng(index).normal(0, 2, (*rgb.shape[:2], 1)), 0, 255).astype(np.uint8)


def still_error(flow, here, pair):
    """The error of points that stay where they are at frame 2."""
    return motion_error(here, here, torch.ones(len(here)), *flow.inputs(2, pair))


def test_flow_on_plain_tissue_counts_less():
    frames = TrainingFrames(PlainerWall(velocity=(0.06, 0.03, 0.0)), 1 << 20, CPU)
    weighed, plain = FlowSupervision(frames), FlowSupervision(frames, precision=False)
    width = weighed.size[0]
    for pair, other in zip(weighed.pairs[2], plain.pairs[2], strict=True):
        assert torch.equal(pair.flow, other.flow)
        assert (other.precision == 1).all()
        textured, bare = (pair.precision[0][8:-8, part].float().mean() for part in (slice(8, width // 2 - 8), slice(width // 2 + 8, -8)))
        assert bare < 0.1 * textured
        inside = np.random.default_rng(5).uniform(-0.8, 0.8, (300, 2))
        here = torch.from_numpy((np.c_[inside, np.full(300, 3.0)] + 2 * frames.clip.velocity) * frames.unit).float()
        right = here[:, 0] > 0.2
        for side, factor in ((right, 0.1), (~right, 1.0)):
            error, trusting = (still_error(weighed, here[side], p) for p in (pair, other))
            assert error <= factor * trusting


class NoisyDepthWall(MovingWall):
    """A wall whose depth is measured with an error of 2 %."""

    def depth(self, index):
        depth = super().depth(index)
        return depth * (1 + 0.02 * np.random.default_rng(index).standard_normal(depth.shape)).astype(np.float32)


def test_flow_counts_by_one_over_its_error_as_a_loss_that_grows_with_the_distance_asks():
    errors = LEAST_ERROR * np.array([0.0, 1.0, 100.0, 200.0])
    counts = precision_of(errors)
    assert counts[:2] == pytest.approx([1, 0.5**0.5])
    assert counts[2] == pytest.approx(2 * counts[3], rel=1e-3)


def test_depth_counts_by_its_precision():
    walls = [wall(velocity=(0.06, 0.03, 0.0)) for wall in (MovingWall, NoisyDepthWall)]
    exact, noisy = (FlowSupervision(TrainingFrames(wall, 1 << 20, CPU)) for wall in walls)
    assert exact.depth_precision > 0.95
    assert noisy.depth_precision < 0.1
    assert FlowSupervision(TrainingFrames(walls[1], 1 << 20, CPU), depth_precision=False).depth_precision == 1
    assert FlowSupervision(TrainingFrames(MovingWall(velocity=(0.06, 0.03, 0.0), measured=False), 1 << 20, CPU)).depth_precision == 0


def test_what_noisy_depth_seems_to_do_is_hardly_believed():
    """The true motion costs a fifth of what it costs where the noise is believed, or less."""
    frames = TrainingFrames(NoisyDepthWall(velocity=(0.06, 0.03, 0.0)), 1 << 20, CPU)
    weighed, believing = FlowSupervision(frames), FlowSupervision(frames, depth_precision=False)
    inside = np.random.default_rng(6).uniform(-0.6, 0.6, (300, 2))
    here, there = (torch.from_numpy((np.c_[inside, np.full(300, 3.0)] + i * frames.clip.velocity) * frames.unit).float() for i in (2, 3))
    costs = []
    for flow in (weighed, believing):
        pair = flow.pair(2, 3)
        costs.append(float(motion_error(here, there, torch.ones(300), *flow.inputs(2, pair))))
    assert costs[0] < 0.2 * costs[1]
