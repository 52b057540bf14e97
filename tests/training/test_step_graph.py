"""A step as one CUDA graph learns what the step in parts does, and makes room where its tiles show more than before."""

import math

import numpy as np
import pytest
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.profile import recording
from degense.engine.training import step_graph
from degense.engine.training.config import TrainConfig
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from degense.engine.training.trainer import Trainer
from tests.fakes import MemoryClip


def trainer_on(device, **settings):
    frames = TrainingFrames(MemoryClip(width=96, height=80), 1 << 20, torch.device(device))
    canonical, bounds = initial_gaussians(frames, None, 600, 0, np.random.default_rng(0), 4)
    torch.manual_seed(0)
    model = SceneModel(FieldConfig(channels=8, resolution=8, time_resolution=4, color_knots=4), bounds, canonical).to(device)
    for parameter in model.geometry.parameters():  # zero-initialised last layers would hide a way
        if not parameter.any():
            torch.nn.init.normal_(parameter, 0, 0.02)
    config = TrainConfig.preset_of("balanced", device=device, iterations=400, coarse_iterations=4, max_gaussians=700, **settings)
    return Trainer(model, frames, None, FlowSupervision(frames), config, lambda event: None)


def gradients_of(trainer):
    return {name: p.grad.clone() for name, p in trainer.model.named_parameters() if p.grad is not None}


def test_without_a_gpu_a_step_is_taken_in_parts():
    assert trainer_on("cpu")._step_graph is None


@pytest.mark.cuda
def test_it_finds_the_gradients_losses_and_evidence_of_the_step_in_parts():
    whole = trainer_on("cuda")
    with recording("cuda"):
        parts = trainer_on("cuda")
    assert parts._step_graph is None
    for step in range(24):  # the coarse stage and the joint one; with and without smoothness; begun, recorded and replayed
        parts.restore(whole.state())
        whole.step()
        parts.step()
        found, expected = gradients_of(whole), gradients_of(parts)
        assert found.keys() == expected.keys()
        for name, gradient in expected.items():
            assert (found[name] - gradient).norm() <= 0.02 * gradient.norm() + 1e-7, (step, name)
        (loss, error, terms), (same, other, named) = whole.sums.means(1), parts.sums.means(1)
        assert (loss, error) == pytest.approx((same, other), rel=2e-3)
        assert terms == pytest.approx(named, rel=5e-3, abs=1e-6)
        for name, evidence in parts.density.state().items():
            assert torch.allclose(whole.density.state()[name], evidence, rtol=0.02, atol=2e-4), (step, name)
    assert {kind[1] > 0 for kind in whole._step_graph._recorded} == {True}


@pytest.mark.cuda
def test_where_tiles_show_more_than_there_is_room_for_the_last_steps_are_taken_again(monkeypatch):
    monkeypatch.setattr(step_graph, "ROOM", 1)
    trainer = trainer_on("cuda")
    while trainer.iteration < 90:
        trainer.step()
    order = trainer.order.state()
    with torch.no_grad():  # all Gaussians grow: far more tiles show each
        trainer.model.canonical["log_scales"] += math.log(4)
    while trainer.iteration > 1:  # step 100 finds the lists too short and goes back to the last guard, which was at the start
        trainer.step()
    assert trainer.iteration == 0
    assert trainer.rollbacks == 0
    assert trainer.rate_scale == 1
    assert trainer.order.state() != order
    while trainer.iteration < 100:
        trainer.step()
    assert trainer.iteration == 100
    assert trainer._step_graph._room >= int(trainer._step_graph._needed)


@pytest.mark.cuda
def test_a_field_that_no_longer_learns_gets_no_gradient_and_the_rest_goes_on():
    trainer = trainer_on("cuda", motion_iterations=8)
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
