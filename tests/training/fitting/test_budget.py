"""Budgets that fit: plain and busy, still and moving, short and long clips; and what a training does with them."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

import degense.engine.training.job as job
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.events import Budget
from degense.engine.semantics.basis import Basis
from degense.engine.training import PRESETS, TrainConfig, train
from degense.engine.training.fitting.budget import choose, fit_budget, shortened
from degense.engine.training.fitting.statistics import Statistics, gaussians_needed, knots_needed, noise_of
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from tests.fakes import MemoryClip, MovingWall


class PlainWall(MovingWall):
    """A wall of soft shades with sensor noise."""

    def frame(self, index):
        soft = cv2.GaussianBlur(super().frame(index).astype(np.float32), (0, 0), 4)
        noise = np.random.default_rng(index).normal(0, 1.5, soft.shape)
        return np.clip(np.round(128 + (soft - 128) * 1.4 + noise), 0, 255).astype(np.uint8)


def fitted(clip, **changes):
    frames = TrainingFrames(clip, 1 << 20, torch.device("cpu"))
    config = replace(TrainConfig.preset_of("balanced", device="cpu"), **changes)
    return fit_budget(frames, config, FlowSupervision(frames) if len(clip.train_frames) > 1 else None)


@pytest.fixture(scope="module")
def busy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("busy") / "clip"
    make_phantom(folder, PhantomOptions(frames=16, width=112, height=84, seed=4))
    return fitted(open_clip(folder))


@pytest.fixture(scope="module")
def still():
    return fitted(PlainWall(16, 112, 84, (0, 0, 0)))


def test_a_plain_still_scene_gets_little_and_a_busy_one_much(still, busy):
    plain, full = still.config, busy.config
    assert plain.max_gaussians < 0.5 * full.max_gaussians
    assert plain.resolution * max(plain.levels) <= 0.25 * full.resolution * max(full.levels)
    assert plain.time_resolution <= 3 < full.time_resolution
    assert plain.iterations < full.iterations
    assert full.appearance
    assert not plain.appearance
    assert still.statistics.motion < 0.1 < busy.statistics.motion
    assert still.statistics.delta_color < 2 < busy.statistics.delta_color


def test_a_budget_is_never_more_than_the_preset(still, busy):
    for name in PRESETS:
        config = TrainConfig.preset_of(name, device="cpu")
        for found in (still.statistics, busy.statistics):
            for choice in choose(found, config, 16, 14):
                assert choice.why
                if choice.setting == "levels":
                    assert set(choice.chosen) <= set(choice.preset)
                else:
                    assert choice.chosen <= choice.preset, choice


def test_the_same_clip_gets_the_same_budget(still):
    again = fitted(PlainWall(16, 112, 84, (0, 0, 0)))
    assert again == still


def test_what_is_given_by_hand_stays():
    clip = PlainWall(9, 64, 48, (0, 0, 0))
    config = TrainConfig.preset_of("quick", device="cpu", max_gaussians=9000, iterations=700)
    frames = TrainingFrames(clip, 1 << 20, torch.device("cpu"))
    budget = fit_budget(frames, config, FlowSupervision(frames))
    assert (budget.config.max_gaussians, budget.config.iterations) == (9000, 700)
    assert {"max_gaussians", "iterations"}.isdisjoint(choice.setting for choice in budget.choices)
    assert budget.config.resolution < config.resolution
    preset = TrainConfig.preset_of("quick", device="cpu", max_gaussians=PRESETS["quick"]["max_gaussians"])
    assert fit_budget(frames, preset, FlowSupervision(frames)).config.max_gaussians == PRESETS["quick"]["max_gaussians"]


def test_fewer_iterations_shorten_the_coarse_stage_in_proportion_and_say_so():
    for preset, iterations, coarse in (("quick", 120, 24), ("quick", 2000, 160), ("balanced", None, 600), ("best", 5000, 500)):
        config = TrainConfig.preset_of(preset, iterations=iterations)
        assert config.coarse_iterations == coarse
        assert bool(shortened(config)) is (coarse < PRESETS[preset]["coarse_iterations"])
    assert shortened(TrainConfig.preset_of("quick", iterations=120, coarse_iterations=100)) == []
    wall = PlainWall(9, 64, 48, (0, 0, 0))
    longest = fitted(wall, iterations=8000, coarse_iterations=4000)
    assert longest.config.coarse_iterations == longest.config.iterations // 2 < 4000
    assert any(line.startswith("coarse iterations") and "instead of 4,000" in line for line in longest.words)


def figures(**changes):
    values = {
        "noise": 1.0,
        "gaussians": 1e6,
        "unmatched": 0.5,
        "cells": 128,
        "knots": 1000,
        "delta_color": 100.0,
        "motion": 10.0,
        "believed": 0.9,
    }
    return Statistics(**(values | changes))


def chosen(found, config, count, train_count):
    return {choice.setting: choice.chosen for choice in choose(found, config, count, train_count)}


def test_a_scene_that_needs_everything_gets_everything():
    for name in PRESETS:
        config = TrainConfig.preset_of(name)
        got = chosen(figures(), config, 120, 105)
        assert got.pop("time_resolution") == 60
        assert got == {key: getattr(config, key) for key in got}


def test_each_figure_decides_its_own_setting():
    config = TrainConfig.preset_of("best", levels=(1, 2, 4))
    full = chosen(figures(), config, 120, 105)

    def differences(**changes):
        got = chosen(figures(**changes), config, 120, 105)
        return {key: got[key] for key in got if got[key] != full[key]}

    assert set(differences(gaussians=1000)) == {"max_gaussians"}
    assert differences(gaussians=0.0) == {"max_gaussians": 1000}  # never an empty scene
    assert set(differences(knots=4)) == {"time_resolution"}
    assert differences(cells=64) == {"levels": (1, 2), "resolution": 48}
    assert differences(cells=10) == {"levels": (1,), "resolution": 16}
    assert differences(delta_color=1.0) == {"appearance": False}
    assert differences(believed=0.0) == {"flow": 0.0}
    assert differences(motion=0.0, delta_color=1.0) == {"appearance": False, "iterations": 5_000}


def test_short_clips_need_fewer_steps():
    config = TrainConfig.preset_of("balanced")
    steps = [chosen(figures(), config, count, count)["iterations"] for count in (1, 5, 10, 20, 500)]
    assert steps == [800, 2000, 3000, 3000, 3000]


def test_a_single_frame_and_a_black_one_have_a_budget():
    single = fitted(MemoryClip(1))
    assert single.config.time_resolution == 2
    assert single.config.flow == 0.0

    class Black(MemoryClip):
        def frame(self, index):
            return np.zeros_like(self.wall)

    budget = fitted(Black(6))
    assert budget.config.max_gaussians == 1000
    assert all(np.isfinite(value) for value in budget.to_json()["statistics"].values())

    class Hidden(MemoryClip):
        def valid(self, index):
            return super().valid(index) & (index == 0)

    assert fitted(Hidden(6)).config.flow == 0.0


def test_noise_is_measured_where_there_is_texture_too():
    random = np.random.default_rng(5)
    wall = MovingWall(2, 128, 96).frame(0)
    for sigma in (1.0, 3.0, 6.0):
        noisy = np.clip(np.round(wall + random.normal(0, sigma, (*wall.shape[:2], 1))), 0, 255).astype(np.uint8)
        assert noise_of(noisy) == pytest.approx(sigma, rel=0.25)


def test_more_detail_takes_more_gaussians_and_noise_takes_none():
    random, valid = np.random.default_rng(6), np.ones((96, 96), bool)
    x = np.arange(96)

    def grating(wavelength):
        return np.repeat(np.broadcast_to(128 + 60 * np.sin(2 * np.pi * x / wavelength), (96, 96))[..., None], 3, 2).astype(np.uint8)

    needed = [gaussians_needed(grating(w), valid, 0.0) for w in (4, 8, 16, 32, 64)]
    assert needed == sorted(needed, reverse=True)
    assert needed[0] > 10 * needed[-1]
    flat = np.full((96, 96, 3), 128.0)
    noisy = np.clip(flat + random.normal(0, 2, (96, 96, 1)), 0, 255).astype(np.uint8)
    assert gaussians_needed(noisy, valid, noise_of(noisy)) < 1.5 * gaussians_needed(flat.astype(np.uint8), valid, 0.0)
    half = valid.copy()
    half[:48] = False
    assert gaussians_needed(grating(8), half, 0.0) == pytest.approx(needed[1] / 2, rel=0.05)


def test_moments_follow_the_speed_of_change():
    t = np.linspace(0, 1, 49)

    def needed(signal):
        return knots_needed([np.full((12, 2), value) for value in signal], 0.3)

    assert needed(np.zeros(49)) == needed(20 * t) == 2
    assert needed(10 * np.abs(t - 0.5)) == 3
    waves = [needed(10 * np.sin(2 * np.pi * cycles * t)) for cycles in (1, 2, 4)]
    assert waves == sorted(waves)
    assert waves[-1] > waves[0]
    assert needed(10 * np.random.default_rng(7).normal(size=49)) == 49


def test_the_rank_and_what_was_dropped_are_on_record():
    clip = MemoryClip(3)
    frames = TrainingFrames(clip, 1 << 20, torch.device("cpu"))
    basis = Basis(np.eye(12, 4, dtype=np.float32), 0.9993)
    record = fit_budget(frames, TrainConfig.preset_of("quick", device="cpu"), None, basis).to_json()["chosen"]["rank"]
    assert (record["preset"], record["chosen"]) == (12, 4)
    assert "99.93%" in record["why"]
    assert "8 were left out" in record["why"]


def test_a_run_says_what_was_skipped(tmp_path, monkeypatch):
    monkeypatch.setattr(job, "fingerprint", lambda clip: str(clip.path))
    events = []
    for name, fit in (("fitted", True), ("full", False)):
        config = TrainConfig.preset_of("quick", device="cpu", iterations=3, channels=8, fit=fit)
        run = train(PlainWall(6, 64, 48, (0, 0, 0)), tmp_path / name, config, events=events.append, stop=lambda: False)
        told = [event for event in events if isinstance(event, Budget)]
        record = json.loads((tmp_path / name / "run.json").read_text())
        if fit:
            assert record["budget"]["chosen"]["max_gaussians"]["chosen"] == record["config"]["max_gaussians"] < 12_000
            assert record["field"]["time_resolution"] == record["budget"]["chosen"]["time_resolution"]["chosen"] == 3
            assert record["config"]["iterations"] == 3
            assert any(re.match(r"max gaussians [\d,]+ instead of 12,000: ", line) for line in told[0].words)
            assert "at most" not in told[0].words[-1]
            assert len(run.load_model()) <= record["config"]["max_gaussians"]
        else:
            assert record["budget"] is None
            assert record["config"]["max_gaussians"] == 12_000
            assert told[1].words == ["coarse iterations 0 instead of 160: in proportion to 3 steps in all"] == told[0].words[:1]
