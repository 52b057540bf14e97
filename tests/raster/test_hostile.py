"""Input that nobody wants: the CPU and the reference follow the policy written in `rasterize`."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from degense.engine.camera import Camera
from degense.engine.raster import check, rasterize
from degense.engine.raster.check import Case, compare, hostile_cases
from degense.engine.raster.scenes import random_scene

SEED = 5


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
    tensors, camera = random_scene(60, 47, 33, 4, SEED)
    tensors[2].copy_(tensors[2][:, :1].expand(-1, 3).clone())  # balls: turning them changes nothing
    real = check.draw

    def draw(case, device, backend="auto"):
        render, gradients = real(case, device, backend)
        if backend != "reference":
            gradients["quats"] = torch.full_like(gradients["quats"], wrong / gradients["quats"].numel() ** 0.5)
        return render, gradients

    monkeypatch.setattr(check, "draw", draw)
    assert compare(Case("balls", [*tensors, None, None], camera), "cpu").passes is passes


@pytest.mark.parametrize("backend", ["cpu", "reference"])
@pytest.mark.parametrize("which", range(5))
@pytest.mark.parametrize("value", [torch.nan, torch.inf, -torch.inf])
def test_a_gaussian_with_a_bad_number_leaves_no_trace(backend, which, value):
    tensors, camera = random_scene(30, 20, 15, 2, SEED)
    without = rasterize(*(tensor[1:] for tensor in tensors), camera, backend=backend)
    tensors[which].view(30, -1)[0, -1] = value
    leaves = [tensor.requires_grad_() for tensor in tensors]
    render = rasterize(*leaves, camera, backend=backend)
    assert render.radii[0] == 0
    assert torch.equal(render.image.detach(), without.image)
    render.image.sum().backward()
    for leaf in leaves:
        assert (leaf.grad[0] == 0).all()
        assert leaf.grad.isfinite().all()


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_zero_quaternions_are_the_identity(backend):
    tensors, camera = random_scene(30, 20, 15, 2, SEED)
    tensors[1][:] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    identity = rasterize(*tensors, camera, backend=backend).image
    tensors[1] = torch.zeros(30, 4, requires_grad=True)
    zero = rasterize(*tensors, camera, backend=backend).image
    assert torch.equal(identity, zero.detach())
    zero.sum().backward()
    assert (tensors[1].grad == 0).all()


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_no_gaussians_give_the_background(backend):
    camera = Camera(5, 4, 5.0, 5.0, 2.5, 2.0)
    shapes = ((0, 3), (0, 4), (0, 3), (0,), (0, 2))
    render = rasterize(*(torch.zeros(shape) for shape in shapes), camera, background=torch.tensor([0.25, 0.5]), backend=backend)
    assert (render.image.numpy() == np.array([0.25, 0.5])).all()
    assert (render.alpha == 0).all()
    assert render.radii.shape == (0,)


wild = st.floats(width=32) | st.sampled_from([0.0, 1e-12, 1e6, 1e30, -1.0, float("nan"), float("inf")]) | st.floats(-2, 2, width=32)


@settings(max_examples=25, deadline=None)
@given(
    numbers=st.lists(st.tuples(st.integers(0, 4), st.integers(0, 11), st.integers(0, 3), wild), max_size=12),
    size=st.tuples(st.integers(1, 40), st.integers(1, 20)),
    seed=st.integers(0, 1000),
)
def test_wild_numbers_anywhere_stay_finite_and_agree(numbers, size, seed):
    tensors, camera = random_scene(12, *size, 4, seed, footprint=4.0)
    for which, gaussian, component, value in numbers:
        row = tensors[which].view(12, -1)[gaussian]
        row[component % len(row)] = value
    tensors[4] = tensors[4].clamp(-10, 10)  # enormous colours only magnify rounding
    result = compare(Case("wild", [*tensors, None, torch.zeros(12, 2)], camera), "cpu")
    assert result.finite
    assert result.outliers * size[0] * size[1] <= 2
    assert result.image <= 10 * (1 / 255 + 1e-3)


def test_wrong_arguments_are_named():
    tensors, camera = random_scene(6, 8, 8, 3, SEED)

    def refused(match, *, backend="auto", camera=camera, **changes):
        names = ("means", "quats", "scales", "opacities", "features")
        arguments = [changes.pop(name, tensor) for name, tensor in zip(names, tensors, strict=True)]
        with pytest.raises(ValueError, match=match):
            rasterize(*arguments, camera, backend=backend, **changes)

    refused("means must have shape", means=tensors[0][0])
    refused("quats must have shape", quats=tensors[1][:, :3])
    refused("scales must have shape", scales=tensors[2][:5])
    refused("opacities must have shape", opacities=tensors[3][:, None])
    refused("features", features=tensors[4][:, :0])
    refused("background must have shape", background=torch.zeros(4))
    refused("screen_offsets must have shape", screen_offsets=torch.zeros(6, 3))
    refused("floating-point", features=torch.zeros(6, 3, dtype=torch.int32))
    refused("one device", features=tensors[4].to("meta"))
    refused("backend is 'opengl'", backend="opengl")
    refused("cannot draw tensors on cpu", backend="cuda")
    refused("at least 1 × 1", camera=Camera(0, 8, 5.0, 5.0, 4.0, 4.0))
    refused("focal lengths", camera=Camera(8, 8, 0.0, 5.0, 4.0, 4.0))
