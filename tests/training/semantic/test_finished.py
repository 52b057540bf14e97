"""What is kept of a finished geometry gives what the scene itself gives, values and gradients."""

import numpy as np
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.raster import rasterize
from degense.engine.training.config import TrainConfig
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from degense.engine.training.passes import SemanticPass
from degense.engine.training.semantic.finished import FinishedGeometry, FinishedLatents
from tests.fakes import MemoryClip

RANK = 5


def model_of(frames, **settings):
    """A model of which everything semantic has something to say."""
    torch.manual_seed(2)
    canonical, bounds = initial_gaussians(frames, None, 300, RANK, np.random.default_rng(0), 3)
    model = SceneModel(FieldConfig(rank=RANK, color_knots=3, resolution=16, time_resolution=4, **settings), bounds, canonical)
    for parameter in model.parameters():
        if not parameter.any():
            torch.nn.init.normal_(parameter, 0, 0.1)
    model.set_semantic_coefficients(torch.randn(len(model), 3, RANK))
    return model


def semantic(model):
    parts = [part for part in (model.semantic, model.semantic_planes) if part is not None]
    return [model.canonical["semantics"], *(parameter for part in parts for parameter in part.parameters())]


def outcome(model, latents, regularizer):
    weight = torch.randn(latents.shape, generator=torch.Generator().manual_seed(0))
    loss = (latents * weight).sum() + 100 * regularizer
    return [latents.detach(), *torch.autograd.grad(loss, semantic(model), allow_unused=True)]


def check(model, frames):
    model.canonical["temporal_windows"].data.zero_()  # all are there at all times
    config = TrainConfig()
    geometry, scene = FinishedGeometry(model, frames), SemanticPass(model, config, deform=True)
    kept = FinishedLatents(geometry, config)
    for frame in (0, 2, 0):
        *shape, latents, regularizer = scene(torch.tensor(frames.clip.time(frame)))
        splats = geometry.splats(frame)
        for one, other in zip((splats.means, splats.quats, splats.scales, splats.opacities), shape, strict=True):
            torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-4)
        for one, other in zip(outcome(model, *kept(frame)), outcome(model, latents, regularizer), strict=True):
            torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-4)


def test_a_frame_is_drawn_from_where_its_gaussians_are_then():
    frames = TrainingFrames(MemoryClip(), 1 << 20, torch.device("cpu"))
    geometry = FinishedGeometry(model_of(frames), frames)
    for frame in (0, 3, 0):
        splats = geometry.splats(frame)
        expected = rasterize(splats, splats.colors, frames.cameras[frame]).image
        torch.testing.assert_close(geometry.placed(frame).draw(splats.colors), expected)


def test_it_is_the_semantic_pass():
    frames = TrainingFrames(MemoryClip(), 1 << 20, torch.device("cpu"))
    check(model_of(frames), frames)


def test_it_is_the_semantic_pass_where_latents_follow_no_colour_or_never_change():
    frames = TrainingFrames(MemoryClip(), 1 << 20, torch.device("cpu"))
    plain, fixed = model_of(frames), model_of(frames, fixed_latents=True)
    plain.semantic_coefficients = None
    check(plain, frames)
    check(fixed, frames)


def test_latents_are_drawn_alike_where_some_gaussians_are_never_there():
    frames = TrainingFrames(MemoryClip(), 1 << 20, torch.device("cpu"))
    model = model_of(frames)
    model.canonical["temporal_windows"].data[::3] = torch.tensor([9.0, 2.0])
    config = TrainConfig(delta_semantics=0.0)
    geometry = FinishedGeometry(model, frames)
    found, _ = FinishedLatents(geometry, config)(1)
    *_, latents, _ = SemanticPass(model, config, deform=True)(torch.tensor(frames.clip.time(1)))
    assert not torch.equal(found, latents)  # those that are not there are left out
    pictures = [geometry.placed(1).draw(values) for values in (found, latents)]
    torch.testing.assert_close(*pictures, rtol=1e-3, atol=1e-4)
    gradients = [torch.autograd.grad(picture.square().sum(), semantic(model)) for picture in pictures]
    for one, other in zip(*gradients, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-3)
