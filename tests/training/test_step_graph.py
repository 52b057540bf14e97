"""A step as one CUDA graph learns what the step in parts does, and makes room where its tiles show more than before.

Without a GPU a stand-in for graphs calls functions again where a GPU replays what it recorded of them.
"""

import math
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.profile import recording
from degense.engine.raster import rasterize
from degense.engine.raster.cuda import DrawnInGraph
from degense.engine.training import step_graph
from degense.engine.training import trainer as training
from degense.engine.training.config import TrainConfig
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from tests.fakes import MemoryClip

GRAPHS = [False, pytest.param(True, marks=pytest.mark.cuda)]


def trainer_on(device, **settings):
    frames = TrainingFrames(MemoryClip(width=96, height=80), 1 << 20, torch.device(device))
    canonical, bounds = initial_gaussians(frames, None, 600, 0, np.random.default_rng(0), 4)
    torch.manual_seed(0)
    model = SceneModel(FieldConfig(channels=8, resolution=8, time_resolution=4, color_knots=4), bounds, canonical).to(device)
    for parameter in model.geometry.parameters():  # zero-initialised last layers would hide a way
        if not parameter.any():
            torch.nn.init.normal_(parameter, 0, 0.02)
    config = TrainConfig.preset_of("balanced", device=device, iterations=400, coarse_iterations=4, max_gaussians=700, **settings)
    return training.Trainer(model, frames, None, FlowSupervision(frames), config, lambda event: None)


def in_parts(device):
    with recording(device):
        trainer = trainer_on(device)
    trainer._rows = lambda t: (None, None)  # all Gaussians, as on a GPU
    return trainer


@pytest.fixture
def as_one(monkeypatch):
    """Makes trainers whose steps are one graph, on a GPU or with the stand-in, and which look every tenth step whether all is well."""
    monkeypatch.setattr(training, "GUARD_EVERY", 10)

    def make(on_gpu, **settings):
        if on_gpu:
            return trainer_on("cuda", **settings)
        stand_in(monkeypatch)
        trainer = trainer_on("cpu", **settings)
        trainer._rows = lambda t: (None, None)
        trainer.passes.in_step_graph = True
        trainer._step_graph = step_graph.StepGraph(trainer.model, trainer.passes, trainer.density, trainer.sums)
        return trainer

    return make


def stand_in(monkeypatch):
    stream = SimpleNamespace(wait_stream=lambda other: None)
    for name, value in (("Stream", lambda: stream), ("current_stream", lambda: stream), ("stream", lambda other: nullcontext())):
        monkeypatch.setattr(torch.cuda, name, value)
    monkeypatch.setattr(step_graph, "warm_up", lambda function: function())

    def capture(function):
        result = []
        return SimpleNamespace(replay=lambda: result.__setitem__(slice(None), function())), result

    def draw(splats, features, camera, matrices, offsets, room):
        drawn = rasterize(splats, features, camera, screen_offsets=offsets, clean=True)
        return DrawnInGraph(drawn.image, drawn.alpha, drawn.radii, drawn.radii.sum().long())

    monkeypatch.setattr(step_graph, "capture", capture)
    monkeypatch.setattr(step_graph, "rasterize_in_graph", draw)


def gradients_of(trainer):
    return {name: p.grad.clone() for name, p in trainer.model.named_parameters() if p.grad is not None}


def test_without_a_gpu_a_step_is_taken_in_parts():
    assert trainer_on("cpu")._step_graph is None


@pytest.mark.parametrize("on_gpu", GRAPHS)
def test_it_finds_the_gradients_losses_and_evidence_of_the_step_in_parts(as_one, on_gpu):
    whole, parts = as_one(on_gpu), in_parts("cuda" if on_gpu else "cpu")
    assert parts._step_graph is None
    error = 0.02 if on_gpu else 1e-5
    for step in range(24):  # the coarse stage and the joint one; with and without smoothness; begun, recorded and replayed
        parts.restore(whole.state())
        whole.step()
        parts.step()
        found, expected = gradients_of(whole), gradients_of(parts)
        assert found.keys() == expected.keys()
        for name, gradient in expected.items():
            assert (found[name] - gradient).norm() <= error * gradient.norm() + 1e-7, (step, name)
        (loss, squared, terms), (same, other, named) = whole.sums.means(1), parts.sums.means(1)
        assert (loss, squared) == pytest.approx((same, other), rel=error / 10)
        assert terms == pytest.approx(named, rel=error / 4, abs=1e-6)
        for name, evidence in parts.density.state().items():
            assert torch.allclose(whole.density.state()[name], evidence, rtol=error, atol=error / 100), (step, name)
    assert {kind[1] > 0 for kind in whole._step_graph._recorded} == {True}


def grow_after(trainer, steps: int) -> None:
    """Let all Gaussians grow after some steps, so that far more tiles show each, and train on until steps are taken again."""
    while trainer.iteration < steps:
        trainer.step()
    with torch.no_grad():
        trainer.model.canonical["log_scales"] += math.log(4)
    while trainer.iteration > 1:
        trainer.step()


@pytest.mark.parametrize("on_gpu", GRAPHS)
def test_where_tiles_show_more_than_there_is_room_for_the_last_steps_are_taken_again(as_one, on_gpu, monkeypatch):
    monkeypatch.setattr(step_graph, "ROOM", 1.5)
    trainer = as_one(on_gpu)
    grow_after(trainer, 8)  # the tenth step finds the lists too short and goes back to the last guard, which was at the start
    assert (trainer.iteration, trainer.rollbacks, trainer.rate_scale) == (0, 0, 1)
    while trainer.iteration < 10:
        trainer.step()
    assert trainer.last_finite["plain"]["iteration"] == 10
    assert trainer._step_graph._room >= trainer._step_graph._least_room > int(trainer._step_graph._needed)


@pytest.mark.parametrize("on_gpu", GRAPHS)
def test_too_little_room_is_noticed_where_the_stage_changed_since(as_one, on_gpu, monkeypatch):
    monkeypatch.setattr(step_graph, "ROOM", 1.5)
    trainer = as_one(on_gpu)
    grow_after(trainer, 2)  # steps 3 and 4 of the coarse stage have too little room, those of the joint one enough
    assert trainer.iteration == 0
    while trainer.iteration < 10:
        trainer.step()
    assert trainer.last_finite["plain"]["iteration"] == 10


@pytest.mark.parametrize("on_gpu", GRAPHS)
def test_a_training_that_diverged_is_not_taken_for_one_without_room(as_one, on_gpu):
    trainer = as_one(on_gpu)
    while trainer.iteration < 9:
        trainer.step()
    with torch.no_grad():
        trainer.model.canonical["colors"][0] = math.nan
    trainer._step_graph._needed.fill_(1 << 40)
    trainer._step_graph._lacked.fill_(1 << 40)
    trainer.step()
    assert (trainer.iteration, trainer.rollbacks, trainer.rate_scale) == (0, 1, 0.5)
    trainer.step()
    trainer.step()
    assert trainer._step_graph._room < 1 << 30


@pytest.mark.parametrize("on_gpu", GRAPHS)
def test_a_field_that_no_longer_learns_gets_no_gradient_and_the_rest_goes_on(as_one, on_gpu):
    trainer = as_one(on_gpu, motion_iterations=8)
    for _ in range(14):
        trainer.step()
    still = {name: p.detach().clone() for name, p in trainer.model.named_parameters() if name.startswith(("planes.", "geometry."))}
    colours = trainer.model.canonical["colors"].detach().clone()
    assert not [name for name in gradients_of(trainer) if name.startswith(("planes.", "kinematics.", "geometry.", "appearance."))]
    for _ in range(4):
        trainer.step()
    now = dict(trainer.model.named_parameters())
    assert all(torch.equal(value, now[name]) for name, value in still.items())
    assert not torch.equal(colours, trainer.model.canonical["colors"])
