"""Input that nobody wants: the CPU and the reference follow the policy written at the head of `raster.render`."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from degense.engine.camera import Camera
from degense.engine.raster import rasterize
from degense.engine.research.bench import raster_check as check
from degense.engine.research.bench.raster_check import Case, compare, hostile_cases
from degense.engine.research.bench.raster_scenes import draw_scene, random_scene
from degense.engine.splats import Splats

SEED = 5
DRAWN = ("means", "quats", "scales", "opacities", "semantics")


@pytest.mark.parametrize("case", list(hostile_cases(SEED)), ids=lambda case: case.name)
def test_policy_is_the_references(case):
    result = compare(case, "cpu")
    assert result.finite
    assert result.radii == 0
    assert result.outliers <= 2e-3
    assert max(result.image, result.alpha) <= 1 / 255 + 1e-3
    assert all(error <= 1e-2 for error in result.gradients.values()), result.gradients


@pytest.mark.parametrize(("wrong", "passes"), [(3e-7, True), (1e-3, False)], ids=["rounding", "wrong"])
def test_a_gradient_that_symmetry_makes_zero_is_measured_by_the_cases_largest(monkeypatch, wrong, passes):
    splats, camera = random_scene(60, 47, 33, 4, SEED)
    splats.scales.copy_(splats.scales[:, :1].expand(-1, 3).clone())  # balls: turning them changes nothing
    real = check.draw

    def draw(case, device, backend="auto"):
        render, gradients = real(case, device, backend)
        if backend != "reference":
            gradients["quats"] = torch.full_like(gradients["quats"], wrong / gradients["quats"].numel() ** 0.5)
        return render, gradients

    monkeypatch.setattr(check, "draw", draw)
    assert compare(Case("balls", splats, camera), "cpu").passes is passes


@pytest.mark.parametrize("backend", ["cpu", "reference"])
@pytest.mark.parametrize("which", DRAWN)
@pytest.mark.parametrize("value", [torch.nan, torch.inf, -torch.inf])
def test_a_gaussian_with_a_bad_number_leaves_no_trace(backend, which, value):
    splats, camera = random_scene(30, 20, 15, 2, SEED)
    without = draw_scene(splats.map(lambda tensor: tensor[1:]), camera, backend=backend)
    getattr(splats, which).view(30, -1)[0, -1] = value
    leaves = [getattr(splats, name).requires_grad_() for name in DRAWN]
    render = draw_scene(splats, camera, backend=backend)
    assert render.radii[0] == 0
    assert torch.equal(render.image.detach(), without.image)
    render.image.sum().backward()
    for leaf in leaves:
        assert (leaf.grad[0] == 0).all()
        assert leaf.grad.isfinite().all()


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_zero_quaternions_are_the_identity(backend):
    splats, camera = random_scene(30, 20, 15, 2, SEED)
    splats.quats[:] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    identity = draw_scene(splats, camera, backend=backend).image
    splats.quats = torch.zeros(30, 4, requires_grad=True)
    zero = draw_scene(splats, camera, backend=backend).image
    assert torch.equal(identity, zero.detach())
    zero.sum().backward()
    assert (splats.quats.grad == 0).all()


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_no_gaussians_give_the_background(backend):
    camera = Camera(5, 4, 5.0, 5.0, 2.5, 2.0)
    shapes = ((0, 3), (0, 4), (0, 3), (0,), (0, 3), (0, 2))
    render = draw_scene(Splats(*(torch.zeros(shape) for shape in shapes)), camera, background=torch.tensor([0.25, 0.5]), backend=backend)
    assert (render.image.numpy() == np.array([0.25, 0.5])).all()
    assert (render.alpha == 0).all()
    assert render.radii.shape == (0,)


wild = st.floats(width=32) | st.sampled_from([0.0, 1e-12, 1e6, 1e30, -1.0, float("nan"), float("inf")]) | st.floats(-2, 2, width=32)


@settings(max_examples=25)
@given(
    numbers=st.lists(st.tuples(st.integers(0, 4), st.integers(0, 11), st.integers(0, 3), wild), max_size=12),
    size=st.tuples(st.integers(1, 40), st.integers(1, 20)),
    seed=st.integers(0, 1000),
)
def test_wild_numbers_anywhere_stay_finite_and_agree(numbers, size, seed):
    splats, camera = random_scene(12, *size, 4, seed, footprint=4.0)
    for which, gaussian, component, value in numbers:
        row = getattr(splats, DRAWN[which]).view(12, -1)[gaussian]
        row[component % len(row)] = value
    splats.semantics.clamp_(-10, 10)  # enormous features only magnify rounding
    result = compare(Case("wild", splats, camera, None, torch.zeros(12, 2)), "cpu")
    assert result.finite
    assert result.outliers * size[0] * size[1] <= 2
    assert result.image <= 10 * (1 / 255 + 1e-3)


def test_wrong_arguments_are_named():
    sound, camera = random_scene(6, 8, 8, 3, SEED)

    def refused(match, *, backend="auto", camera=camera, features=sound.semantics, **changes):
        splats = sound.map(torch.clone)
        for name in DRAWN:
            setattr(splats, name, changes.pop(name, getattr(splats, name)))
        with pytest.raises(ValueError, match=match):
            rasterize(splats, features, camera, backend=backend, **changes)

    refused("means must have shape", means=sound.means[0])
    refused("quats must have shape", quats=sound.quats[:, :3])
    refused("scales must have shape", scales=sound.scales[:5])
    refused("opacities must have shape", opacities=sound.opacities[:, None])
    refused("features", features=sound.semantics[:, :0])
    refused("background must have shape", background=torch.zeros(4))
    refused("screen_offsets must have shape", screen_offsets=torch.zeros(6, 3))
    refused("floating-point", features=torch.zeros(6, 3, dtype=torch.int32))
    refused("one device", features=sound.semantics.to("meta"))
    refused("backend is 'opengl'", backend="opengl")
    refused("cannot draw tensors on cpu", backend="cuda")
    refused("at least 1 × 1", camera=Camera(0, 8, 5.0, 5.0, 4.0, 4.0))
    refused("focal lengths", camera=Camera(8, 8, 0.0, 5.0, 4.0, 4.0))
