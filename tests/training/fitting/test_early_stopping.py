"""When training cools down early, and the arithmetic of the shortened schedule."""

import json
import math

import numpy as np
import pytest

from degense.engine.events import EarlyStopped, TrainingProgress
from degense.engine.metrics.evaluate import evaluate
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train
from degense.engine.training.fitting.early_stopping import EarlyStopping, Schedule, StoppingRule, validation_frames
from degense.engine.training.trainer import Trainer
from tests.fakes import MemoryClip


def curve(step, ceiling=30.0, speed=400.0):
    """A score that rises ever more slowly."""
    return ceiling - 12 * math.exp(-step / speed)


def stops_at(scores, patience=300, every=50, gain=0.1):
    rule = StoppingRule(patience, gain)
    return next((step for step in range(every, 10_000, every) if rule.observe(step, scores(step))), None)


def test_it_waits_while_there_is_gain_and_stops_when_there_is_none():
    step = stops_at(curve)
    gained = curve(step) - curve(step - 300)
    assert gained < 0.1
    assert curve(step - 50) - curve(step - 350) >= 0.1  # not later than it can be known
    assert stops_at(lambda step: 20 + step * 0.001) is None  # 0.3 dB in the patience: worth going on


def test_noise_neither_stops_a_rising_score_nor_keeps_a_flat_one():
    stops = []
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0, 0.1, 10_000)
        stops.append(stops_at(lambda step, noise=noise: curve(step) + noise[step], patience=600))
    quiet = stops_at(curve, patience=600)
    assert all(step is not None and 0.6 * quiet < step < 1.6 * quiet for step in stops), (quiet, stops)


def test_nothing_is_known_before_the_patience_is_over():
    rule = StoppingRule(300)
    assert not any(rule.observe(step, 25.0) for step in range(50, 301, 50))
    assert rule.observe(350, 25.0)


def test_scores_that_are_no_numbers_do_not_count():
    rule = StoppingRule(100)
    assert not any(rule.observe(step, value) for step, value in ((50, math.nan), (100, math.inf), (200, math.nan), (300, -math.inf)))
    assert rule.scores == []


def test_the_schedule_without_an_early_stop():
    schedule = Schedule(1000, 0.3)
    assert (schedule.total, schedule.progress(0), schedule.progress(250), schedule.progress(1000)) == (1000, 0.0, 0.25, 1.0)
    assert not schedule.cooling(699)
    assert schedule.cooling(700)


@pytest.mark.parametrize("iterations", [1, 2, 7, 800, 6000])
@pytest.mark.parametrize("cooldown", [0.05, 0.3, 1.0])
def test_the_cool_down_is_whole_whenever_it_begins(iterations, cooldown):
    whole = Schedule(iterations, cooldown)
    begins = next(step for step in range(iterations) if whole.cooling(step))
    for step in {0, iterations // 3, begins, iterations - 1}:
        short = whole.cool_down(step)
        assert short.cooling(step)
        assert short.progress(short.total) == 1.0
        assert short.progress(step) == max(whole.progress(begins), whole.progress(step))
        assert short.total - step == min(iterations - begins, iterations - step)
        assert short.total <= iterations
        assert short.cool_down(step) == short
        steps = [short.progress(later) for later in range(step, short.total + 1)]
        assert np.allclose(np.diff(steps), 1 / iterations)


@pytest.mark.parametrize("values", [(0, 0.3, 0), (10, 0.0, 0), (10, 1.1, 0), (10, 0.3, 10), (10, 0.3, -1)])
def test_schedules_that_make_no_sense(values):
    with pytest.raises(ValueError, match="no schedule"):
        Schedule(*values)


@pytest.mark.parametrize("count", [1, 42, 99, 100, 137, 2000])
def test_validation_frames_are_few_inner_training_frames(count):
    train = list(range(0, 2 * count, 2))
    chosen = validation_frames(train)
    assert len(chosen) == (4 if count >= 100 else 0)
    assert set(chosen) <= set(train[1:-1])
    if chosen:
        assert min(np.diff(chosen)) >= 2 * (count // 4 - 1)


def test_frames_are_held_out_only_until_the_cool_down():
    early = EarlyStopping(1000, range(120), patience=200)
    assert early.held_out(100) == frozenset(early.frames)
    fired = [step for step in range(50, 500, 50) if early.observe(step, 25.0)]
    assert fired == [250]  # once
    assert early.held_out(250) == frozenset()
    assert early.schedule.total == 250 + 300
    assert early.to_json()["chosen"] == 550
    assert "200 steps" in early.to_json()["why"]


def test_nobody_looks_after_half_of_the_schedule():
    early = EarlyStopping(1000, range(120), patience=200)
    assert early.held_out(499) == frozenset(early.frames)
    assert early.held_out(500) == frozenset()
    assert not any(early.observe(step, 25.0) for step in range(500, 1000, 50))
    assert early.schedule.total == 1000
    assert early.to_json()["chosen"] == 1000


def test_a_resumed_early_stop_goes_on_as_the_same():
    whole, first = EarlyStopping(1000, range(120)), EarlyStopping(1000, range(120))
    scores = {step: curve(step, speed=60) for step in range(20, 700, 20)}
    for step in range(20, 300, 20):
        whole.observe(step, scores[step])
        first.observe(step, scores[step])
    second = EarlyStopping(1000, range(120))
    second.restore(**json.loads(json.dumps(first.state())))
    for step in range(300, 700, 20):
        assert whole.observe(step, scores[step]) == second.observe(step, scores[step])
    assert whole.schedule == second.schedule
    assert whole.schedule.skipped > 0


def test_short_clips_train_to_the_end():
    early = EarlyStopping(1000, range(99))
    assert early.held_out(0) == frozenset()
    assert early.schedule.total == 1000
    assert "too few" in early.to_json()["why"]


class Noise(MemoryClip):
    """A grey wall under noise that no two frames share: there is little to learn and much that cannot be learned."""

    def frame(self, index):
        return np.random.default_rng(index).normal(120, 20, self.wall.shape).clip(0, 255).astype(np.uint8)

    def depth(self, index):
        return np.full(self.wall.shape[:2], 2.0, np.float32)


def trained(out, iterations):
    """A training of preset quick with early stopping: its events, the finished run, and what its scores say of the early stop."""
    clip = Noise(116, labels=False)
    values = {"max_gaussians": 300, "channels": 8, "resolution": 8, "flow": 0.0, "device": "cpu"}
    config = TrainConfig.preset_of("quick", iterations=iterations, early_stopping=True, **values)
    events = []
    train(clip, out, config, teacher="none", events=events.append, stop=lambda: False)
    scene = Scene.open(out, device="cpu", clip=clip)
    return events, scene.run, evaluate(scene, clip)["budget"]["chosen"]["early stopping"]


def test_a_training_whose_validation_frames_stop_improving_ends_early_and_says_so(tmp_path, monkeypatch):
    """Scores are given, so that nothing depends on rounding: they rise until step 150, the second that is looked at, then never again."""
    monkeypatch.setattr(Trainer, "validation_psnr", lambda self: min(self.iteration, 150) / 10)
    events, run, record = trained(tmp_path / "run", 600)
    (stop,) = [event for event in events if isinstance(event, EarlyStopped)]
    # patience is 100 steps: at 250 the best of 200 and 250 is no better than that of 150; the last 30 % of 600 steps follow
    assert (stop.iteration, stop.iterations) == (250, 430)
    assert run.info["iteration"] == 430
    assert [event.iteration for event in events if isinstance(event, TrainingProgress)][-1] == 430
    assert (record["preset"], record["chosen"], record["why"]) == (600, 430, stop.reason)


def test_whether_or_not_a_real_training_stops_early_its_record_is_true(tmp_path):
    events, run, record = trained(tmp_path / "run", 300)
    stops = [event for event in events if isinstance(event, EarlyStopped)]
    assert len(stops) <= 1
    assert record["chosen"] == run.info["iteration"] == (stops[0].iterations if stops else 300)
    assert record["why"] == (stops[0].reason if stops else "the validation frames improved as long as they were watched")
