"""The scene model: identity at the start, routings, and where gradients may go."""

import pytest
import torch

from engine.camera import Camera
from engine.field import ROUTINGS, FieldConfig, SceneModel
from engine.field.model import CANONICAL
from engine.raster import rasterize
from engine.training.trainer import draw_latents

CAMERA = Camera(24, 20, 20.0, 20.0, 12.0, 10.0)


def make(routing, rank=4, count=60, seed=0):
    torch.manual_seed(seed)
    canonical = {
        "means": torch.rand(count, 3) * torch.tensor([1.0, 0.8, 0.4]) + torch.tensor([-0.5, -0.4, 0.8]),
        "log_scales": torch.full((count, 3), -3.0) + 0.3 * torch.randn(count, 3),
        "quats": torch.randn(count, 4),
        "logits": torch.randn(count),
        "colors": torch.rand(count, 3),
        "semantics": torch.randn(count, rank),
        "lifetimes": torch.zeros(count, 2),
    }
    bounds = torch.tensor([[-0.6, -0.5, 0.7], [0.6, 0.5, 1.3]])
    return SceneModel(FieldConfig(routing, rank, channels=8, resolution=8, time_resolution=4), bounds, canonical)


def stir(model):
    """Give every zero-initialised last layer something to say."""
    for parameter in model.parameters():
        if parameter.abs().max() == 0:
            torch.nn.init.normal_(parameter, 0, 0.05)


@pytest.mark.parametrize("routing", ROUTINGS)
def test_an_untrained_field_is_the_identity(routing):
    model = make(routing)
    canonical, moved = model.at(0.3, deform=False).splats, model.at(0.3).splats
    for name in vars(canonical):
        assert torch.equal(getattr(canonical, name), getattr(moved, name)), name


@pytest.mark.parametrize("routing", ROUTINGS)
def test_where_the_semantic_loss_may_go(routing):
    """isolated: ∂L_sem/∂geometry is exactly zero. paper: it reaches planes and base net, not Ψ_geo's output layer through the decoder.

    coupled: it bends geometry.
    """
    model = make(routing)
    stir(model)
    latent = draw_latents(model.at(0.4).splats, CAMERA, detached=routing == "isolated")
    latent.square().sum().backward()

    def touched(parameters):
        return any(p.grad is not None and bool((p.grad != 0).any()) for p in parameters)

    geometry = [model.canonical[name] for name in CANONICAL if name != "semantics"]
    shared = [*model.planes.parameters(), *model.kinematics.parameters()]
    assert touched([model.canonical["semantics"]])
    assert touched(model.semantic.parameters())
    expected = routing != "isolated"
    assert touched(geometry) is expected
    assert touched(shared) is expected
    assert touched(model.geometry.parameters()) is expected
    if routing == "isolated":
        assert touched(model.semantic_planes.parameters())
        for parameter in (*geometry, *shared, *model.geometry.parameters(), *model.appearance.parameters()):
            assert parameter.grad is None or torch.count_nonzero(parameter.grad) == 0


def test_the_coupled_baseline_cannot_change_meaning_without_moving():
    """With no deformation the coupled semantics are one fixed function of f_sem; the decoupled ones may change in time."""
    for routing, free in (("coupled", False), ("paper", True), ("isolated", True)):
        model = make(routing)
        stir(model)
        for parameter in model.geometry.parameters():
            torch.nn.init.zeros_(parameter)
        with torch.no_grad():
            for plane in model.planes.time:
                plane.uniform_(0.2, 2.0)
        before, after = model.at(-0.8).splats, model.at(0.9).splats
        assert torch.equal(before.means, after.means)
        assert bool((before.semantics != after.semantics).any()) is free


def test_means_at_agrees_with_at():
    model = make("isolated")
    stir(model)
    assert torch.equal(model.means_at(0.2), model.at(0.2).splats.means)


def test_appearance_changes_colour_and_nothing_else():
    model = make("isolated")
    for parameter in model.appearance.parameters():
        torch.nn.init.normal_(parameter, 0, 0.1)
    still, coloured = model.at(0.1, deform=False).splats, model.at(0.1).splats
    assert not torch.equal(still.colors, coloured.colors)
    assert torch.equal(still.means, coloured.means)
    assert torch.equal(still.opacities, coloured.opacities)


def test_a_scene_without_semantics_draws():
    model = make("isolated", rank=0)
    splats = model.at(0.0).splats
    assert splats.semantics.shape == (60, 0)
    drawn = rasterize(splats.means, splats.quats, splats.scales, splats.opacities, splats.colors, CAMERA)
    assert drawn.image.shape == (20, 24, 3)


def test_lifetimes_fade_what_is_transient_and_leave_the_rest_alone_for_ever():
    model = make("isolated")
    with torch.no_grad():
        model.canonical["lifetimes"][0] = torch.tensor([0.5, 10.0])
    at, away = model.at(0.5).splats.opacities, model.at(-0.5).splats.opacities
    assert torch.equal(at[1:], away[1:])
    assert at[0] == model.canonical["logits"][0].sigmoid()
    assert away[0] < 1e-6
    away.sum().backward()
    assert torch.count_nonzero(model.canonical["lifetimes"].grad[1:]) == 0
