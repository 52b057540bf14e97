"""Displacement and warp formulas against loops and against the phantom."""

import numpy as np
import torch

from engine.camera import Camera
from engine.motion import displacement, model_flow, spurious
from tests.phantom.conftest import moving  # noqa: F401
from tests.phantom.files import load


def test_displacement_is_the_distance_of_each_gaussian():
    a, b = torch.randn(7, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)), torch.zeros(7, 3, dtype=torch.float64)
    expected = [sum(float(v) ** 2 for v in row) ** 0.5 for row in a]
    np.testing.assert_allclose(displacement(a, b).numpy(), expected)


def test_spurious_matches_a_loop():
    rng = np.random.default_rng(2)
    model, observed = rng.normal(0, 2, (9, 8, 2)), rng.normal(0, 2, (9, 8, 2))
    supported = rng.random((9, 8)) < 0.7
    model[2, 3], observed[4, 5], supported[2, 3], supported[4, 5] = np.nan, np.nan, True, True
    result = spurious(model, observed, supported, tolerance=1.5)
    assert result.dtype == np.float32
    for y in range(9):
        for x in range(8):
            length = np.hypot(*(model[y, x] - observed[y, x]))
            expected = max(0.0, length - 1.5) if supported[y, x] and np.isfinite(length) else np.nan
            np.testing.assert_allclose(result[y, x], expected, atol=1e-5)


def test_model_flow_of_a_still_scene_is_the_cameras_motion():
    viewmat = np.eye(4)
    viewmat[:3, 3] = [2.0, 0, 0]
    now, reference = Camera(20, 10, 30.0, 30.0, 10.0, 5.0, viewmat), Camera(20, 10, 30.0, 30.0, 10.0, 5.0)
    depth = np.full((10, 20), 60.0)
    depth[0, 0] = 0
    flow = model_flow(depth, np.zeros((10, 20, 3)), now, reference)
    assert np.isnan(flow[0, 0]).all()
    np.testing.assert_allclose(flow[1:], np.broadcast_to([-2.0 * 30 / 60, 0], (9, 20, 2)), atol=1e-6)


def test_model_flow_of_the_phantom_lands_on_the_same_tissue(moving):  # noqa: F811
    phantom = load(moving)
    height, width = phantom.depth.shape[1:]
    cameras = [Camera(width, height, phantom.focal, phantom.focal, *phantom.centre, m) for m in phantom.viewmats]
    flow = model_flow(phantom.depth[5], phantom.displacement[5], cameras[5], cameras[0])
    y, x = np.indices((height, width)) + 0.5
    expected, _ = phantom.pixels(phantom.world(5) - phantom.displacement[5], 0)
    np.testing.assert_allclose(flow, expected - np.stack([x, y], -1), atol=2e-3)
    assert np.nanmax(np.linalg.norm(flow, axis=-1)) > 5
