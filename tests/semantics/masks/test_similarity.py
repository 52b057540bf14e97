"""Cosines, against plain loops and hostile latents."""

import numpy as np
import pytest

from degense.engine.semantics.masks.similarity import cosines, normalised


@pytest.mark.parametrize("channels", [1, 2, 9])
def test_cosine_matches_a_loop(channels):
    rng = np.random.default_rng(channels)
    latent = rng.normal(size=(7, 5, channels)).astype(np.float32) * 10.0 ** rng.integers(-3, 4, (7, 5, 1)).astype(np.float32)
    alpha = rng.random((7, 5)).astype(np.float32)
    query = rng.normal(size=channels)
    query /= np.linalg.norm(query)
    (found,) = cosines(normalised(latent, alpha), query[None])
    for y in range(7):
        for x in range(5):
            z = latent[y, x].astype(float)
            assert found[y, x] == pytest.approx(alpha[y, x] * (z @ query) / np.linalg.norm(z), abs=2e-6)


def test_hostile_latents_give_zero_or_a_direction():
    latent = np.ones((2, 4, 2), np.float32)
    latent[0, 0] = 0
    latent[0, 1, 0] = np.nan
    latent[0, 2, 1] = np.inf
    latent[0, 3] = 1e-30
    latent[1, 0] = 3e38
    latent[1, 1] = -1e-4
    unit = normalised(latent)
    np.testing.assert_array_equal(unit[0], 0.0)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(unit[1], [[half, half], [-half, -half], [half, half], [half, half]], atol=1e-6)


def test_alpha_is_clipped():
    alpha = np.array([[np.nan, -1.0, 0.5, 2.0]], np.float32)
    np.testing.assert_allclose(normalised(np.ones((1, 4, 1), np.float32), alpha)[0, :, 0], [0, 0, 0.5, 1])
