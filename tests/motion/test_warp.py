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
            d, variance = np.linalg.norm(model[y, x] - observed[y, x]), spread[y, x] ** 2
            wrong = max(2.0, d**2 - 4 * variance)
            share = wrong / (wrong + variance)
            np.testing.assert_allclose(result[y, x], np.sqrt((share * d) ** 2 + 2 * (1 - share)), rtol=1e-5)


def test_the_warp_shown_is_the_error_to_expect():
    """Errors of a pixel in each direction, seen through the motion around: where warp is alike, their mean square is its square."""
    rng = np.random.default_rng(3)
    spread = rng.uniform(0, 3, (500, 800)).astype(np.float32)
    error = rng.normal(0, 1, (*spread.shape, 2))
    observed = error + rng.normal(0, 1, error.shape) * 0.5**0.5 * spread[..., None]
    warp = contradicted(observed, Observed(np.zeros_like(observed, np.float32), spread == 0, spread))
    for low in np.arange(0.3, 2.4, 0.3):
        inside = (warp >= low) & (warp < low + 0.3)
        shown, true = (np.sqrt(np.mean(np.square(values[inside]))) for values in (warp, np.linalg.norm(error, axis=-1)))
        assert abs(true - shown) < 0.1 * shown + 0.05, low
