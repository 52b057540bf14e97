"""Gaussians placed once are drawn, and summed onto, as by `rasterize` and `backproject`."""

import pytest
import torch

from degense.engine.raster import Placed, backproject, rasterize
from degense.engine.research.bench.raster_scenes import random_scene

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.cuda)]


def scene(device, count=80):
    splats, camera = random_scene(count, 40, 34, 2, 5, turned=True)
    return splats.map(lambda values: values.to(device)), camera


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("channels", [1, 3, 70])
def test_it_draws_what_the_rasterizer_draws_and_features_get_the_same_gradient(device, channels):
    splats, camera = scene(device)
    placed = Placed(splats, camera)
    assert placed.nbytes > len(splats)
    for seed in (1, 2):
        generator = torch.Generator().manual_seed(seed)
        features = torch.randn(len(splats), channels, generator=generator).to(device).requires_grad_()
        pull = torch.randn(camera.height, camera.width, channels, generator=generator).to(device)
        images = placed.draw(features), rasterize(splats, features, camera).image
        torch.testing.assert_close(*images)
        grads = [torch.autograd.grad(image, features, pull)[0] for image in images]
        torch.testing.assert_close(*grads, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("confident", [True, False])
def test_it_sums_values_of_pixels_onto_gaussians(device, confident):
    splats, camera = scene(device)
    generator = torch.Generator().manual_seed(3)
    values, sure = (torch.randn(camera.height, camera.width, 2, generator=generator).to(device) for _ in range(2))
    confidence = sure[..., 0].abs() if confident else None
    found, expected = Placed(splats, camera).backproject(values, confidence), backproject(splats, values, camera, confidence=confidence)
    torch.testing.assert_close(found.total, expected.total, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(found.weight, expected.weight, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("device", DEVICES)
def test_gaussians_that_cannot_be_drawn_are_left_out(device):
    splats, camera = scene(device)
    splats.means[3] = torch.nan
    splats.opacities[4] = torch.inf
    splats.quats[5] = 0.0
    features = torch.ones(len(splats), 1, device=device)
    torch.testing.assert_close(Placed(splats, camera).draw(features), rasterize(splats, features, camera).image)


@pytest.mark.parametrize("device", DEVICES)
def test_of_no_gaussians_there_is_an_empty_picture(device):
    splats, camera = scene(device, 1)
    placed = Placed(splats.map(lambda values: values[:0]), camera)
    assert not placed.draw(torch.ones(0, 2, device=device)).any()
    assert placed.backproject(torch.ones(camera.height, camera.width, 2, device=device)).total.shape == (0, 2)
