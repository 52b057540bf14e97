"""The rasterizer on hostile scenes: finite, never a crash, and what float64 says."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from degense.engine.research.bench.raster_check import GRADIENT_TOLERANCE, Case, compare, draw
from degense.engine.research.bench.raster_scenes import draw_scene, random_scene
from degense.engine.research.raster_reference import rasterize_reference
from degense.engine.research.stress.outcome import sound
from degense.engine.research.stress.scenes import draw_large, small_finding, stress_cases
from degense.engine.splats import Splats

quickly = settings(max_examples=40)
numbers = st.floats(width=32, allow_nan=True, allow_infinity=True)


@pytest.mark.parametrize("case", list(stress_cases(3)), ids=lambda case: case.name)
def test_every_kind_of_degenerate_scene(case):
    finding = small_finding(case, "cpu")
    assert sound(vars(finding)), finding
    assert finding.error < 1e-5
    assert finding.gradient < 1e-3


@quickly
@given(
    columns=st.lists(st.tuples(*[numbers] * 14), min_size=1, max_size=8),
    size=st.tuples(st.integers(1, 24), st.integers(1, 20)),
    background=numbers,
)
def test_any_numbers_at_all_give_finite_pictures_and_gradients(columns, size, background):
    """Means, quaternions, scales, opacity and three colours of every Gaussian are whatever they are."""
    _, camera = random_scene(1, *size, 1, 0)
    table = torch.tensor(columns, dtype=torch.float32)
    means, quats, scales, opacities, colors = (part.contiguous() for part in table.split([3, 4, 3, 1, 3], 1))
    splats = Splats(means, quats, scales, opacities[:, 0], colors, colors.clamp(-1e12, 1e12))
    render, gradients = draw(Case("any", splats, camera, None, torch.zeros(len(table), 2)), "cpu")
    assert render.image.isfinite().all()
    assert ((render.alpha >= 0) & (render.alpha <= 1)).all()
    assert all(gradient.isfinite().all() for gradient in gradients.values())


@quickly
@given(seed=st.integers(0, 10_000), thin=st.integers(-12, 0), size=st.integers(-3, 2), near=st.integers(-2, 3), opaque=st.floats(0, 1))
def test_degenerate_scenes_agree_with_float64(seed, thin, size, near, opaque):
    """Axes of any ratio, any size, any depth, any opacity."""
    splats, camera = random_scene(40, 31, 23, 3, seed)
    splats.means *= 10.0**near
    splats.scales *= 10.0 ** (size + near) * torch.tensor([1.0, 10.0**thin, 10.0 ** (thin / 2)])
    splats.opacities = torch.lerp(splats.opacities, torch.full_like(splats.opacities, opaque), 0.9)
    result = compare(Case("degenerate", splats, camera, None, torch.zeros(40, 2)), "cpu")
    assert result.finite
    assert result.outliers * 31 * 23 <= 2
    assert result.image <= 1 / 255 + 1e-3
    assert result.outliers or max(result.gradients.values()) <= GRADIENT_TOLERANCE


@quickly
@given(seed=st.integers(0, 10_000), order=st.permutations(range(30)))
def test_the_order_of_gaussians_at_distinct_depths_says_nothing(seed, order):
    splats, camera = random_scene(30, 40, 30, 3, seed)
    splats.means *= (torch.linspace(1, 2, 30) / splats.means[:, 2])[:, None]
    one, two = draw_scene(splats, camera), draw_scene(splats.map(lambda tensor: tensor[list(order)]), camera)
    assert torch.equal(one.image, two.image)
    assert torch.equal(one.alpha, two.alpha)
    assert torch.equal(one.radii[list(order)], two.radii)


def test_gaussians_at_one_place_are_drawn_in_their_order():
    splats, camera = random_scene(20, 16, 16, 3, 1)
    splats.means[:] = torch.tensor([0.0, 0.0, 1.0])
    splats.opacities.fill_(1.0)
    splats.scales.fill_(1.0)
    one, two = (draw_scene(s, camera).image[8, 8] for s in (splats, splats.map(lambda tensor: tensor.flip(0))))
    assert torch.allclose(one, splats.semantics[0], atol=0.01)
    assert torch.allclose(two, splats.semantics[-1], atol=0.01)


def test_the_reference_draws_a_window_as_it_is_in_the_whole():
    splats, camera = random_scene(100, 47, 33, 2, 2, footprint=5.0, turned=True)
    background = torch.tensor([0.2, 0.4])
    image, alpha, radii = rasterize_reference(splats, splats.semantics, camera, background, None)
    part = rasterize_reference(splats, splats.semantics, camera, background, None, window=(11, 7, 13, 9))
    assert torch.equal(part[0], image[7:16, 11:24])
    assert torch.equal(part[1], alpha[7:16, 11:24])
    assert torch.equal(part[2], radii)


@pytest.mark.parametrize("footprint", [2.0, 0.0])
def test_large_pictures_are_compared_in_a_window(footprint):
    seconds, _, error, gradient, bad = draw_large(2000, 320, 200, footprint, "cpu")
    assert seconds > 0
    assert error < 1e-5
    assert gradient < 1e-3
    assert bad == 0


def test_what_moves_a_gaussian_by_nothing_changes_nothing():
    """Quaternions of opposite sign and any length are one rotation; the sign of a scale says nothing."""
    splats, camera = random_scene(60, 40, 30, 3, 4)
    drawn = draw_scene(splats, camera).image
    for name, factor in (("quats", -1.0), ("quats", 1e10), ("quats", 1e-10), ("scales", -1.0)):
        changed = replace(splats, **{name: getattr(splats, name) * factor})
        assert (draw_scene(changed, camera).image - drawn).abs().max() < 1e-5
