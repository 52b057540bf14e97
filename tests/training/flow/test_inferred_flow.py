"""Motion of tissue that chars, from how it moved before."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from degense.engine.training.flow.inferred import camera_flow, inferred_pairs, inverse, roughness
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from tests.fakes import MovingWall

CPU = torch.device("cpu")
CHARS, LATE = 8, 10  # frames: when the spot chars, and one in which it has
BREATH, SPOT = 0.08, 0.35  # of the wall's unit: amplitude, about three pixels, and radius of the spot


class BreathingWall(MovingWall):
    """Breathes sideways; a spot chars at frame `CHARS` and, where `static`, stands still, as ever less does what is around it."""

    def __init__(self, static: bool):
        super().__init__(frames=15, width=112, height=90, velocity=(0.0, 0.0, 0.0))
        self.static = static

    def breath(self, index):
        return BREATH * np.sin(2 * np.pi * index / 6.5)

    def material(self, index):
        seen = super().material(index)
        at = seen
        for _ in range(6):
            free = np.clip((np.linalg.norm(at, axis=-1) - SPOT - 0.1) / 0.4, 0, 1) if self.static else np.ones(at.shape[:2])
            at = seen - np.stack([free * self.breath(index), 0 * free], -1)
        return at

    def frame(self, index):
        charred = (index >= CHARS) / (1 + np.exp((np.linalg.norm(self.material(index), axis=-1) - SPOT) / 0.03))
        return (super().frame(index) * (1 - 0.75 * charred)[..., None]).astype(np.uint8)


@pytest.mark.parametrize("static", [True, False])
def test_what_chars_moves_as_it_did_before(static):
    wall = BreathingWall(static)
    flow = FlowSupervision(TrainingFrames(wall, 1 << 20, CPU))
    found = inferred_pairs(flow)
    first, height, width = wall.train_frames[0], 90, 112
    late = next(i for i in wall.train_frames if i >= LATE and abs(wall.breath(i)) > 0.6 * BREATH)
    moved = (0 if static else 1) * wall.breath(late) * 112 / 3
    for here, there, sign in ((first, late, 1), (late, first, -1)):
        spot = np.s_[height // 2 - 6 : height // 2 + 6, width // 2 - 6 : width // 2 + 6]
        assert flow.seen(here, there)[spot].mean() < 0.1, "the recording shows no motion there"
        pair = found[here, there]
        assert (pair.weight[0][spot] == 1).float().mean() > 0.9
        assert float(pair.precision[0][spot].min()) > 0.1
        across = pair.flow[0][spot].float().numpy() * width
        assert np.abs(across - sign * moved).mean() < 0.12 * BREATH * 112 / 3
        seen = torch.from_numpy(flow.seen(here, there))[None]
        assert torch.equal(torch.where(seen, pair.flow, 0), torch.where(seen, flow.pair(here, there).flow, 0)), "what is seen stays"
    assert flow.pair(first, late).weight[0][spot].float().mean() < 0.1, "observability asks what was seen"


def test_nothing_is_inferred_where_nothing_changes_but_at_the_edges():
    wall = MovingWall(frames=8, velocity=(0.03, 0.015, 0.0))
    flow = FlowSupervision(TrainingFrames(wall, 1 << 20, CPU))
    for (here, there), pair in inferred_pairs(flow).items():
        inferred = (pair.weight[0].numpy() > 0) & ~flow.seen(here, there)
        assert inferred[12:-12, 12:-12].mean() < 0.001
        assert inferred.mean() < 0.1
        error = np.linalg.norm(pair.flow.float().numpy().transpose(1, 2, 0) * flow.size - wall.flow(here, there), axis=-1)
        assert error[inferred].mean() < 0.4
        assert error[flow.seen(here, there)].mean() < 0.1


def test_flow_of_a_moving_camera():
    wall = MovingWall(velocity=(0.0, 0.0, 0.0))
    aside = np.eye(4)
    aside[0, 3] = -0.3
    wall.cameras[1:] = [replace(camera, viewmat=aside) for camera in wall.cameras[1:]]
    frames = TrainingFrames(wall, 1 << 20, CPU)
    assert np.allclose(camera_flow(frames, 0, 2, (48, 36)), [-0.3 / 3 * 48, 0], atol=1e-4)


def test_the_inverse_of_a_flow_leads_back():
    y, x = np.mgrid[:40, :60].astype(np.float32)
    there = np.stack([2 + np.sin(y / 7), np.cos(x / 9)], -1)
    back = inverse(there, np.zeros_like(there))
    column, row = (x + back[..., 0])[8:-8, 8:-8], (y + back[..., 1])[8:-8, 8:-8]
    again = np.stack([column + 2 + np.sin(row / 7) - x[8:-8, 8:-8], row + np.cos(column / 9) - y[8:-8, 8:-8]], -1)
    assert np.abs(again).max() < 0.02


def test_roughness_is_the_error_of_flow_and_not_its_slope():
    x = np.mgrid[:96, :128][1].astype(np.float32)
    smooth = np.stack([0.1 * x, -0.05 * x], -1)
    noise = np.random.default_rng(0).normal(0, 0.3, smooth.shape).astype(np.float32)
    known = np.ones(x.shape, bool)
    assert roughness(smooth, known)[:, 16:-16].max() < 0.02
    assert np.isclose(roughness(smooth + noise, known)[:, 16:-16].mean(), 0.3 * np.sqrt(2), rtol=0.05)
