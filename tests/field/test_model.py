"""The scene model: identity at the start, routings, and where gradients may go."""

import pytest
import torch

from degense.engine.camera import Camera
from degense.engine.field import ROUTINGS, FieldConfig, SceneModel
from degense.engine.field.model import CANONICAL
from degense.engine.field.static_gaussians import OPACITY, PIXELS, find_moving, keep_still
from degense.engine.raster import rasterize
from degense.engine.training.passes import draw_latents

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
        "color_residuals": torch.zeros(count, 3, 3),
        "temporal_windows": torch.zeros(count, 2),
        "velocities": torch.zeros(count, 3),
    }
    bounds = torch.tensor([[-0.6, -0.5, 0.7], [0.6, 0.5, 1.3]])
    return SceneModel(FieldConfig(routing, rank, color_knots=3, channels=8, resolution=8, time_resolution=4), bounds, canonical)


def stir(model):
    """Give every zero-initialised last layer something to say."""
    for name, parameter in model.named_parameters():
        if not parameter.any() and name != "canonical.velocities":
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
    s = model.at(0.4).splats
    latent = draw_latents(s, CAMERA, detached=routing == "isolated")
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
    assert torch.equal(model.means_at(0.2), model.at(0.2, semantics=False).splats.means)
    torch.testing.assert_close(model.means_at(0.2), model.at(0.2).splats.means)


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
    drawn = rasterize(splats, splats.colors, CAMERA)
    assert drawn.image.shape == (20, 24, 3)


def test_tints_change_one_gaussians_colour_in_time_and_nothing_else():
    model = make("isolated")
    with torch.no_grad():
        model.canonical["color_residuals"][5, 0] = torch.tensor([0.3, -0.2, 0.1])
    plain, early, late = make("isolated").at(-1.0).splats, model.at(-1.0).splats, model.at(1.0).splats
    expected = torch.zeros(60, 3)
    expected[5] = 5 / 6 * torch.tensor([0.3, -0.2, 0.1])  # the outermost knot is repeated
    assert torch.allclose(early.colors - plain.colors, expected, atol=1e-6)
    assert torch.equal(late.colors, plain.colors)
    assert torch.equal(early.means, plain.means)
    assert torch.equal(early.opacities, plain.opacities)


def test_a_second_time_costs_one_pass_and_agrees_with_means_at():
    model = make("paper")
    stir(model)
    state = model.at(0.2, other=-0.7)
    assert torch.allclose(state.means_at_other, model.means_at(-0.7), atol=1e-6)
    assert torch.allclose(state.splats.means, model.means_at(0.2), atol=1e-6)


@pytest.mark.parametrize("routing", ROUTINGS)
def test_still_gaussians_never_enter_the_field_and_the_picture_stays(routing):
    """With planes that let only one corner of the box move: what is left out changes nothing beyond the stated tolerance."""
    model = make(routing)
    stir(model)
    with torch.no_grad():
        for last in (model.geometry.decode[-1], model.appearance.decode[-1], model.semantic.decode[-1]):
            last.bias.zero_()
            last.weight *= 0.2
        for plane in model.planes.space:
            plane[0, :, : plane.shape[2] // 2] = 0  # the left half of the box reads zero features at every time
        for layer in (
            *model.kinematics.base,
            model.kinematics.states,
            model.geometry.decode[0],
            model.appearance.decode[0],
            model.semantic.decode[0],
        ):
            if isinstance(layer, torch.nn.Linear):
                layer.bias.zero_()
    times = torch.linspace(-1, 1, 7).tolist()
    whole = [model.at(t).splats for t in times]
    moving = find_moving(model, times, focal=20.0)
    assert 0 < len(moving) < len(model)
    model.set_moving(moving)
    for exact, t in zip(whole, times, strict=True):
        left = model.at(t).splats.detach()
        exact = exact.detach()
        assert float((left.means - exact.means).norm(dim=1).max()) * 20.0 <= PIXELS
        assert float((left.opacities - exact.opacities).abs().max()) <= OPACITY
        for name in vars(exact):
            assert torch.allclose(getattr(left, name)[moving], getattr(exact, name)[moving], atol=1e-6), name
    for rows in (torch.tensor([len(model)]), torch.tensor([-1]), torch.tensor([0.5])):
        with pytest.raises(ValueError, match="moving"):
            model.set_moving(rows)


@pytest.mark.parametrize("routing", ROUTINGS)
def test_gaussians_that_hardly_move_keep_their_mean_place(routing):
    model = make(routing)
    stir(model)
    with torch.no_grad():
        for plane in model.planes.parameters():
            plane += 0.3 * torch.randn_like(plane)
        model.canonical["temporal_windows"].zero_()
        model.canonical["temporal_windows"][:5, 1] = 0.01  # transient ones, which are no tissue
    times, other = torch.linspace(-1, 1, 7).tolist(), 0.37
    before = torch.stack([model.at(t).splats.means.detach() for t in times])
    colors = model.at(other).splats.colors.detach()
    peak = (before - before[0]).norm(dim=-1).amax(0) * 20.0
    told = float(peak[5:].median()) + 1e-3  # between two of them
    keep_still(model, times, focal=20.0, told=told)
    still = model.still
    assert torch.equal(still, (peak <= told) & model.persistent)
    assert 0 < int(still.sum()) < len(model) - 5
    for t, exact in zip(times, before, strict=True):
        assert torch.allclose(model.at(t).splats.means[still], before.mean(0)[still], atol=1e-6)
        assert torch.equal(model.at(t).splats.means[~still], exact[~still])
        assert torch.allclose(model.means_at(t), model.at(t).splats.means, atol=1e-6)
    assert torch.allclose(model.at(0.1, other=other).means_at_other, model.means_at(other), atol=1e-6)
    rows = torch.arange(len(model)).flip(0)[::2]
    assert torch.allclose(model.at(0.1, other=other, rows=rows).means_at_other, model.means_at(other)[rows], atol=1e-6)
    assert torch.equal(model.at(other).splats.colors[~still], colors[~still])
    assert not torch.allclose(model.at(other).splats.colors[still], model.canonical["colors"][still], atol=1e-3), "colours go on changing"
    moving = find_moving(model, times, focal=20.0)
    model.set_moving(moving)
    assert torch.allclose(model.at(times[0]).splats.means[still], before.mean(0)[still], atol=1e-6)


@pytest.mark.parametrize("still", [torch.zeros(3, dtype=torch.bool), torch.zeros(60), torch.zeros(60, 1, dtype=torch.bool)])
def test_a_mask_of_still_gaussians_must_fit(still):
    with pytest.raises(ValueError, match="still"):
        make("isolated").set_still(still)


def test_lifetimes_fade_what_is_transient_and_leave_the_rest_alone_for_ever():
    model = make("isolated")
    with torch.no_grad():
        model.canonical["temporal_windows"][0] = torch.tensor([0.5, 10.0])
    at, away = model.at(0.5).splats.opacities, model.at(-0.5).splats.opacities
    assert torch.equal(at[1:], away[1:])
    assert at[0] == model.canonical["logits"][0].sigmoid()
    assert away[0] < 1e-6
    away.sum().backward()
    assert model.canonical["temporal_windows"].grad is None, "lifetimes are given, not learned"


def test_what_exists_for_a_while_goes_straight_on_and_the_rest_never_does():
    model = make("isolated")
    stir(model)
    with torch.no_grad():
        model.canonical["temporal_windows"][:30] = torch.tensor([0.25, 8.0])
        model.canonical["temporal_windows"][30:, 1] = 0
        model.canonical["velocities"].copy_(torch.randn(len(model), 3))
    velocities = model.canonical["velocities"].detach().clone()

    def own(t):
        with torch.no_grad():
            moved = model.at(t).splats.means
            model.canonical["velocities"].zero_()
            field = model.at(t).splats.means
            model.canonical["velocities"].copy_(velocities)
            assert torch.allclose(model.means_at(t), moved, atol=1e-6)
            assert torch.allclose(model.at(-1.0, other=t).means_at_other, moved, atol=1e-6)
            assert torch.allclose(model.linear_motion(t), moved - field, atol=1e-6)
        return moved - field

    for t, lives in ((0.25, 0.0), (0.25 + 1 / 8, 1.0), (0.25 - 1 / 16, -0.5), (1.0, 2.0), (-1.0, -2.0)):
        assert torch.allclose(own(t)[:30], lives * velocities[:30], atol=1e-6)
        assert not own(t)[30:].any()
    model.at(0.3).splats.means.square().sum().backward()
    assert model.canonical["velocities"].grad[:30].all()
    assert not model.canonical["velocities"].grad[30:].any()


def test_only_what_may_be_drawn_at_a_time_is_deformed():
    """Drawn, the scene is the same to the last bit, and the deformed Gaussians have the gradients that they have among all."""
    model, t, other = make("isolated"), torch.tensor(0.1), torch.tensor(-0.4)
    stir(model)
    model.canonical["temporal_windows"].data[::2] = torch.tensor([0.9, 8.0])  # e^(−½ 6.4²) at 0.1
    model.canonical["temporal_windows"].data[::4] = torch.tensor([0.2, 8.0])
    present, rows = model.present(t), torch.tensor([1, 3, 8])
    assert sorted(set(range(60)) - set(present.tolist())) == list(range(2, 60, 4))
    full, found = (model.at(t, semantics=False, other=other, rows=rows, present=asked) for asked in (None, present))
    assert torch.equal(full.splats.means[present], found.splats.means[present])
    assert torch.equal(full.means_at_other, found.means_at_other)
    assert not found.deformation.flat[2::4].any()
    pictures, gradients = [], []
    for state in (full, found):
        model.zero_grad()
        image = rasterize(state.splats, state.splats.colors, CAMERA).image
        image.square().sum().backward()
        pictures.append(image.detach())
        gradients.append(torch.cat([p.grad.flatten() for p in model.parameters() if p.grad is not None]))
    assert torch.equal(*pictures)
    torch.testing.assert_close(*gradients, rtol=1e-4, atol=1e-6)
