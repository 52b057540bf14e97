"""Displacement and warp formulas against loops and against the phantom."""

import numpy as np
import torch

from degense.engine.motion import displacement, spurious


def test_displacement_is_the_distance_of_each_gaussian():
    a, b = torch.randn(7, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)), torch.zeros(7, 3, dtype=torch.float64)
    expected = [sum(float(v) ** 2 for v in row) ** 0.5 for row in a]
    np.testing.assert_allclose(displacement(a, b).numpy(), expected)


def test_spurious_matches_a_loop():
    rng = np.random.default_rng(2)
    model, observed = rng.normal(0, 2, (9, 8, 2)), rng.normal(0, 2, (9, 8, 2))
    tolerance = np.where(rng.random((9, 8)) < 0.7, rng.uniform(0.5, 2, (9, 8)), np.nan)
    model[2, 3], observed[4, 5], tolerance[2, 3], tolerance[4, 5] = np.nan, np.nan, 1, 1
    result = spurious(model, observed, tolerance)
    assert result.dtype == np.float32
    for y in range(9):
        for x in range(8):
            length = np.hypot(*(model[y, x] - observed[y, x]))
            expected = max(0.0, length - tolerance[y, x]) if np.isfinite(length + tolerance[y, x]) else np.nan
            np.testing.assert_allclose(result[y, x], expected, atol=1e-5)
