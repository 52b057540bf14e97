"""What may teach motion, and for how long: optical flow, and the gradient of colour as far as texture stands out from noise."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.raster.camera_tensors import project, view_and_lens
from degense.engine.training.config import PRESETS, TrainConfig
from degense.engine.training.flow.motion_error import look_up
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from degense.engine.training.job import settle
from degense.engine.training.passes import FieldPass, FieldState
from degense.engine.training.trainer import Trainer
from tests.fakes import MemoryClip

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def frames():
    return TrainingFrames(MemoryClip(), 1 << 20, CPU)


def model_of(frames):
    canonical, bounds = initial_gaussians(frames, None, 200, 0, np.random.default_rng(0))
    torch.manual_seed(0)
    model = SceneModel(FieldConfig(channels=8, resolution=8, time_resolution=4), bounds, canonical)
    for parameter in model.geometry.parameters():  # zero-initialised last layers would hide a way
        if not parameter.any():
            torch.nn.init.normal_(parameter, 0, 0.02)
    return model


def gradients(model, frames, precision, of="drawn_means"):
    """Of a random weighing of the centres as they are drawn, or as flow sees them (`of` "means")."""
    config = TrainConfig.preset_of("quick", device="cpu", displacement=0.0, rigidity=0.0, shape=0.0)
    time, other, camera = torch.tensor(0.3), torch.tensor(0.4), view_and_lens(frames.cameras[3], CPU)
    found = FieldState(*FieldPass(model, config, None, deform=True)(time, camera, precision, other))
    where = look_up(torch.ones(1, 20, 30), project(found.means.detach(), camera)[0] * 2 - 1)
    chances = (where > 0.999) * torch.randn(found.means.shape, generator=torch.Generator().manual_seed(1))
    asked = [model.canonical["means"], *model.geometry.parameters()]
    return found, torch.autograd.grad((getattr(found, of) * chances).sum(), asked)


def test_colour_teaches_displacements_by_the_precision_of_texture_and_places_all_of_its_gradient(frames):
    model = model_of(frames)
    _, (place, *motion) = gradients(model, frames, torch.zeros(0))
    found, (same, *part) = gradients(model, frames, torch.full((1, 20, 30), 0.25).half())
    assert torch.equal(found.drawn_means, found.means)
    assert torch.allclose(same, place)
    assert any(gradient.any() for gradient in motion)
    for whole, quarter in zip(motion, part, strict=True):
        assert torch.allclose(quarter, 0.25 * whole, rtol=1e-4, atol=1e-5)
    _, (_, *flow) = gradients(model, frames, torch.zeros(1, 20, 30).half(), "means")
    for whole, same in zip(motion, flow, strict=True):
        assert torch.allclose(same, whole, rtol=1e-4, atol=1e-5)


def test_precision_is_taken_from_the_frame_where_texture_is_and_noise_is_not():
    rng, clip = np.random.default_rng(0), MemoryClip()
    plain, fine = np.full((clip.size[1], clip.size[0], 3), 120.0), rng.normal(0, 40, (clip.size[1], clip.size[0], 1))
    left = np.arange(clip.size[0])[None, :, None] < clip.size[0] // 2
    pictures = [np.clip(plain + left * fine + rng.normal(0, 2, plain.shape), 0, 255).astype(np.uint8) for _ in range(len(clip))]
    clip.frame = lambda index: pictures[index]
    flow = FlowSupervision(TrainingFrames(clip, 1 << 20, CPU))
    precision = flow.precision[0][0].float()
    half = precision.shape[1] // 2
    assert precision[:, : half - 3].mean() > 3 * precision[:, half + 3 :].mean()


@pytest.mark.parametrize(
    ("settings", "asked"), [({"photometric_precision": True}, True), ({}, False), ({"photometric_precision": True, "flow": 0.0}, False)]
)
def test_where_no_flow_teaches_motion_colour_teaches_all_of_it(frames, settings, asked):
    config = TrainConfig.preset_of("quick", device="cpu", **settings)
    trainer = Trainer(model_of(frames), frames, None, FlowSupervision(frames), config, lambda event: None)
    assert len(trainer._precision(0)) == asked
    assert not len(Trainer(model_of(frames), frames, None, None, config, lambda event: None)._precision(0))


@pytest.mark.parametrize(("settings", "with_flow", "resting"), [({}, True, True), ({"stillness": False}, True, False), ({}, False, False)])
def test_tissue_rests_where_flow_cannot_tell_its_motion_from_none(frames, settings, with_flow, resting):
    """The field moves all tissue by hundredths of a pixel: flow cannot see that, and without flow nobody says what it is worth."""
    model, config = model_of(frames), TrainConfig.preset_of("quick", device="cpu", **settings)
    with torch.no_grad():
        model.geometry.decode[-1].weight *= 1e-3
    trainer = Trainer(model, frames, None, FlowSupervision(frames) if with_flow else None, config, lambda event: None)
    settle(trainer)
    assert (model.still is not None) == resting
    if resting:
        assert model.still[model.persistent].all()
        moved = (model.means_at(1.0) - model.means_at(-1.0))[model.persistent]
        assert not moved.any()


def test_presets_with_thousands_of_steps_weigh_colour_by_precision():
    found = {name: TrainConfig.preset_of(name).photometric_precision for name in PRESETS}
    assert found == {"quick": False, "balanced": True, "best": True}


def test_the_field_stands_still_when_its_iterations_are_over_and_colours_go_on(frames):
    config = replace(TrainConfig.preset_of("quick", iterations=12, device="cpu"), coarse_iterations=2, motion_iterations=6)
    trainer = Trainer(model_of(frames), frames, None, FlowSupervision(frames), config, lambda event: None)

    def learned():
        names = ("planes.", "kinematics.", "geometry.", "appearance.")
        field = [p.detach().clone() for name, p in trainer.model.named_parameters() if name.startswith(names)]
        return field, trainer.model.canonical["colors"].detach().clone()

    for _ in range(7):
        trainer.step()
    field, colours = learned()
    for _ in range(5):
        trainer.step()
    later, changed = learned()
    assert all(torch.equal(a, b) for a, b in zip(field, later, strict=True))
    assert not torch.equal(colours, changed)
    assert TrainConfig.preset_of("best").motion_share == pytest.approx(0.3)
    assert TrainConfig.preset_of("best", iterations=2000).motion_share == 1
