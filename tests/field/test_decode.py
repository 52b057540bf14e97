"""The fused field of the CPU against its twin in plain torch, in float64."""

import copy

import pytest
import torch

from degense.engine.field import ROUTINGS, FieldConfig, SceneModel
from degense.engine.threads import one_torch_thread

WITH_CUDA = pytest.mark.cuda


def make(routing, seed, *, count=333, rank=5, appearance=True, levels=(1, 2), linear=False):
    """A model of which every part has something to say, with more Gaussians than one block and none that divides them evenly."""
    torch.manual_seed(seed)
    canonical = {
        "means": torch.rand(count, 3) * 2.2 - 1.1,
        "log_scales": torch.randn(count, 3) - 3,
        "quats": torch.randn(count, 4),
        "logits": torch.randn(count),
        "colors": torch.rand(count, 3),
        "semantics": torch.randn(count, rank),
        "color_residuals": 0.1 * torch.randn(count, 4, 3),
        "temporal_windows": torch.rand(count, 2),
        "velocities": 0.1 * torch.randn(count, 3),
    }
    config = FieldConfig(
        routing, rank, appearance, color_knots=4, channels=8, resolution=8, time_resolution=5, levels=levels, linear_states=linear
    )
    model = SceneModel(config, torch.tensor([[-1.0, -1, -1], [1, 1, 1]]), canonical)
    for name, parameter in model.named_parameters():
        if ".time." in name:
            torch.nn.init.uniform_(parameter, 0.5, 1.5)
        elif ".bias" in name or not parameter.any():
            torch.nn.init.normal_(parameter, 0, 0.1)
    return model


@pytest.mark.parametrize("semantics", [True, False])
@pytest.mark.parametrize("appearance", [True, False])
@pytest.mark.parametrize("routing", ROUTINGS)
def test_it_says_what_the_twin_says_in_float64(routing, appearance, semantics):
    model = make(routing, 7 + ROUTINGS.index(routing), appearance=appearance)
    twin = copy.deepcopy(model).double()
    for t in (-1.0, 0.37, torch.tensor(0.9)):
        with torch.no_grad():
            fused, exact, centres = model.at(t, semantics=semantics), twin.at(t, semantics=semantics), model.means_at(t)
        for name, value in vars(exact.splats).items():
            assert torch.allclose(getattr(fused.splats, name).double(), value, rtol=1e-4, atol=1e-4), name
        assert torch.equal(centres, fused.splats.means)
        assert (fused.delta_color is None) is not appearance
        assert (fused.delta_semantics is None) is not semantics


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=WITH_CUDA)])
@pytest.mark.parametrize("gradients", [False, True], ids=["inference", "training"])
def test_linear_states_are_equation_1(device, gradients):
    """φ_k(h_base) has no nonlinearity: against the matrices themselves, in float64, with and without gradients."""
    model = make("paper", 11, linear=True)
    twin = copy.deepcopy(model).double()
    rectified = make("paper", 11)
    rectified.load_state_dict(model.state_dict())
    model, rectified = model.to(device), rectified.to(device)
    with torch.no_grad():
        base, states = twin.kinematics.base, twin.kinematics.states
        latent = base(twin.planes(twin.normalised(twin.canonical["means"]), 0.3)) @ states.weight.T + states.bias
        moved, semantics = twin.geometry(latent)[:, :3], twin.semantic(latent)
        expected = twin.canonical["means"] + twin.linear_motion(0.3) + moved
    assert (latent < 0).any()
    with torch.set_grad_enabled(gradients):
        found, other = model.at(0.3), rectified.at(0.3)
    torch.testing.assert_close(found.splats.means.double().cpu(), expected, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(found.delta_semantics.double().cpu(), semantics, rtol=1e-4, atol=1e-4)
    assert (found.splats.means - other.splats.means).abs().max() > 1e-2


@pytest.mark.parametrize("levels", [(1,), (1, 2, 3)])
def test_any_number_of_levels(levels):
    model = make("isolated", 3, levels=levels)
    plain = model.at(0.2).splats
    with torch.no_grad():
        fused = model.at(0.2).splats
    assert plain.means.requires_grad
    for name, value in vars(plain).items():
        assert torch.allclose(getattr(fused, name), value, rtol=1e-4, atol=1e-4), name


def test_only_what_moves_enters_it_and_other_times_are_told_too():
    model = make("isolated", 4)
    model.set_moving(torch.arange(0, len(model), 3))
    plain = model.at(0.2).splats
    with torch.no_grad():
        fused = model.at(0.2).splats
        still = model.canonical["log_scales"].exp()
    assert torch.equal((fused.scales != still).any(1).nonzero()[:, 0], model.moving)
    assert torch.allclose(fused.means, plain.means, atol=1e-4)
    model.moving = None
    with torch.no_grad():
        assert torch.allclose(model.at(0.2, other=-0.4).means_at_other, model.means_at(-0.4), atol=1e-4)


def test_the_number_of_threads_changes_nothing():
    model = make("isolated", 5, count=3000)
    with torch.no_grad():
        several = model.at(0.1).splats
        with one_torch_thread(1):
            one = model.at(0.1).splats
    for name, value in vars(several).items():
        if name in ("colors", "semantics"):  # products of torch, which may add in another order
            torch.testing.assert_close(getattr(one, name), value, rtol=1e-6, atol=1e-6)
        else:
            assert torch.equal(getattr(one, name), value), name


def test_no_gaussians_and_gaussians_without_a_place():
    with torch.no_grad():
        assert make("isolated", 6, count=0).at(0.1).splats.semantics.shape == (0, 5)
        model = make("isolated", 6)
        model.canonical["means"][0] = torch.nan
        splats = model.at(0.1).splats
    assert torch.isfinite(splats.colors).all()
    assert torch.isfinite(splats.means[1:]).all()
