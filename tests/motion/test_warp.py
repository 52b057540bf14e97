"""Displacement and warp formulas against loops."""

import numpy as np
import torch

from degense.engine.motion.observed import Observed, contradicted, displacement


def test_displacement_is_the_distance_of_each_gaussian():
    a, b = torch.randn(7, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)), torch.zeros(7, 3, dtype=torch.float64)
    expected = [sum(float(v) ** 2 for v in row) ** 0.5 for row in a]
    np.testing.assert_allclose(displacement(a, b).numpy(), expected)


def test_what_the_recording_contradicts_matches_a_loop():
    rng = np.random.default_rng(2)
    model, observed = rng.normal(0, 2, (9, 8, 2)), rng.normal(0, 2, (9, 8, 2))
    spread = np.where(rng.random((9, 8)) < 0.5, rng.uniform(0.5, 2, (9, 8)), 0)
    model[2, 3], spread[4, 5] = np.nan, np.nan
    result = contradicted(model, Observed(observed.astype(np.float32), spread == 0, spread.astype(np.float32)))
    assert result.dtype == np.float32
    for y in range(9):
        for x in range(8):
            expected = np.linalg.norm([*(model[y, x] - observed[y, x]), 0.5 * spread[y, x]])
            np.testing.assert_allclose(result[y, x], expected, rtol=1e-5)
