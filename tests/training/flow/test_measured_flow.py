"""Which pairs of training frames flow is measured between, on a wall whose motion is known exactly."""

from itertools import combinations

import numpy as np
import pytest
import torch

from degense.engine.training.flow.measured import flow_pairs, key_frames, measure_flow
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import FrameOrder, TrainingFrames
from tests.fakes import MovingWall

CPU = torch.device("cpu")


@pytest.mark.parametrize(("count", "keys"), [(2, [0]), (3, [0, 1]), (4, [0, 1, 2]), (10, [0, 3, 6]), (48, [0, 15, 31])])
def test_neighbours_and_all_frames_of_a_key_frame_are_pairs_once(count, keys):
    assert key_frames(count) == keys
    pairs = flow_pairs(count)
    wanted = {frozenset(ends) for ends in combinations(range(count), 2) if ends[1] - ends[0] == 1 or set(ends) & set(keys)}
    assert {frozenset(pair) for pair in pairs} == wanted
    assert len(pairs) == len(wanted)


def test_flow_comes_in_the_order_of_its_pairs():
    clip = MovingWall(8, velocity=(0.04, 0.02, 0.0), seed=3)
    frames = [clip.frame(i) for i in range(8)]
    found = list(measure_flow(frames))
    pairs = flow_pairs(8)
    assert len(found) == len(pairs)
    for (here, there), (forward, backward) in zip(pairs, found, strict=True):
        inside = np.s_[12:-12, 14:-14]
        for flow, a, b in ((forward, here, there), (backward, there, here)):
            assert np.median(np.linalg.norm(flow - clip.flow(a, b), axis=-1)[inside]) < 0.3, (a, b)


def test_measuring_can_be_left_at_any_pair():
    clip = MovingWall(6)
    for asked in (0, 3, 9):
        found = measure_flow([clip.frame(i) for i in range(6)])
        for _ in range(asked):
            next(found)
        found.close()


SPOT, MIDDLE = np.s_[16:56, 8:44], np.s_[28:44, 18:34]


class Covered(MovingWall):
    """An instrument lies on the wall in the first frames."""

    def frame(self, index):
        frame = super().frame(index)
        if index < 4:
            frame[SPOT] = np.random.default_rng(0).integers(0, 255, frame[SPOT].shape)
        return frame


def tools(frame):
    tool = np.zeros((72, 96), bool)
    tool[SPOT] = frame < 4
    return tool


def test_what_the_first_frame_does_not_show_is_followed_from_another_key_frame():
    clip = Covered(13, velocity=(0.01, 0.005, 0.0), seed=5)
    flow = FlowSupervision(TrainingFrames(clip, 1 << 20, CPU), tools=tools)
    train = clip.train_frames
    first, second, late = train[0], train[key_frames(len(train))[1]], train[-1]
    assert second >= 4
    assert not flow.seen(late, first)[MIDDLE].any()
    assert flow.seen(late, second)[MIDDLE].mean() > 0.9
    error = np.linalg.norm(flow.flow(late, second) - clip.flow(late, second), axis=-1)[MIDDLE]
    assert np.median(error) < 0.2


class Burnt(MovingWall):
    """From a frame on, before the second key frame, a spot of the wall is dark."""

    def frame(self, index):
        frame = super().frame(index)
        if index >= 3:
            frame[SPOT] //= 3
        return frame


def test_what_has_changed_its_look_since_the_first_frame_shows_no_motion_to_any_key_frame():
    clip = Burnt(13, velocity=(0.0, 0.0, 0.0), seed=5)
    flow = FlowSupervision(TrainingFrames(clip, 1 << 20, CPU))
    train = clip.train_frames
    keys, late = [train[key] for key in key_frames(len(train))], train[-1]
    beside = np.s_[24:48, 62:80]
    for key in keys:
        assert not flow.seen(late, key)[MIDDLE].any()
        assert flow.seen(late, key)[beside].all()
        assert not flow.seen(key, late)[MIDDLE].any()


@pytest.mark.parametrize("frame", [2, 8])
def test_two_of_three_steps_learn_from_neighbours(frame):
    clip = MovingWall(12)
    flow, order = FlowSupervision(TrainingFrames(clip, 1 << 20, CPU)), FrameOrder(clip.train_frames, 1)
    train = clip.train_frames
    assert train.index(frame) not in key_frames(len(train))
    drawn = [order.any_of(flow.drawn_from(frame)).to for _ in range(3000)]
    near = {train[train.index(frame) + way] for way in (-1, 1)}
    far = {train[key] for key in key_frames(len(train))}
    assert set(drawn) == near | far
    apart = far - near
    assert np.mean([to in near for to in drawn]) == pytest.approx(6 / (6 + len(apart)), abs=0.03)
