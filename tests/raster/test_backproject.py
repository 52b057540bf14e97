"""Back-projection against the blending weights themselves, and as the transpose of the rasterizer."""

import pytest
import torch

from degense.engine.raster import backproject, rasterize
from degense.engine.research.bench.raster_scenes import random_scene


def scene(seed, **options):
    """Gaussians, their camera, random values [H, W, 3] and confidences [H, W] for the pixels; all float64."""
    splats, camera = random_scene(80, 24, 18, 2, seed, **options)
    generator = torch.Generator().manual_seed(seed)
    values = torch.randn(camera.height, camera.width, 3, generator=generator).double()
    return splats.map(torch.Tensor.double), camera, values, torch.rand(camera.height, camera.width, generator=generator).double()


@pytest.mark.parametrize(("backend", "tolerance"), [("reference", 1e-12), ("cpu", 2e-4)])
@pytest.mark.parametrize("turned", [False, True])
def test_sums_and_means_are_those_of_the_blending_weights(backend, tolerance, turned):
    """The weights are found by drawing every Gaussian as a channel of its own, in float64."""
    splats, camera, values, confidence = scene(3, turned=turned)
    weights = rasterize(splats, torch.eye(len(splats)).double(), camera, backend="reference").image.reshape(-1, len(splats))
    weights = weights * confidence.reshape(-1, 1)
    got = backproject(splats, values, camera, confidence=confidence, backend=backend)
    torch.testing.assert_close(got.total.double(), weights.T @ values.reshape(-1, 3), atol=tolerance, rtol=tolerance)
    torch.testing.assert_close(got.weight.double(), weights.sum(0), atol=tolerance, rtol=tolerance)
    seen = got.weight > 1e-2
    expected = (weights.T @ values.reshape(-1, 3))[seen] / weights.sum(0)[seen, None]
    mean = got.total / got.weight.clamp_min(1e-12)[:, None]
    torch.testing.assert_close(mean[seen].double(), expected, atol=50 * tolerance, rtol=50 * tolerance)
    assert not got.total[got.weight == 0].any()


@pytest.mark.parametrize(("backend", "tolerance"), [("reference", 1e-12), ("cpu", 1e-4)])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_is_the_adjoint_of_the_rasterizer(backend, tolerance, seed):
    splats, camera, values, _ = scene(seed, footprint=5.0)
    features = torch.randn(len(splats), 3, generator=torch.Generator().manual_seed(seed + 1)).double()
    image = rasterize(splats, features, camera, backend=backend).image.double()
    back = backproject(splats, values, camera, backend=backend).total.double()
    torch.testing.assert_close((image * values).sum(), (features * back).sum(), rtol=tolerance, atol=tolerance)


def test_without_gradients_wanted_it_still_works():
    splats, camera, values, _ = scene(5)
    with torch.no_grad():
        assert not backproject(splats, values, camera).total.requires_grad
