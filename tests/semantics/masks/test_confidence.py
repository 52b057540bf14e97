"""The curve from margins to chances: fitted, drawn on masks, and refused where it is none."""

import numpy as np
import pytest

from degense.engine.semantics.basis import Basis
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.masks.confidence import BINS, ConfidenceCurve


def test_a_curve_finds_the_chances_that_its_pixels_were_drawn_with():
    random = np.random.default_rng(0)
    margin = random.uniform(0, 1, 200_000)
    right = random.random(len(margin)) < np.sqrt(margin)
    place = (margin * BINS).astype(int)
    curve = ConfidenceCurve.fitted(*(np.bincount(place, weight, BINS) for weight in (None, margin, right)))
    asked = np.linspace(0.05, 0.95, 19)
    np.testing.assert_allclose(curve(asked), np.sqrt(asked), atol=0.03)
    assert ConfidenceCurve.from_json(curve.to_json()) == curve


def test_estimates_that_fall_or_exceed_all_are_mended():
    pixels = np.array([10.0, 0, 10, 20])
    curve = ConfidenceCurve.fitted(pixels, pixels * [0.1, 0, 0.5, 0.9], np.array([5.0, 0, 3, 22]))
    assert curve.margins == pytest.approx((0.1, 0.5, 0.9))
    assert curve.chances == pytest.approx((0.4, 0.4, 1.0))
    with pytest.raises(ValueError, match="no pixels"):
        ConfidenceCurve.fitted(np.zeros(3), np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("points", [{}, {"margins": [0, 0], "chances": [0, 1]}, {"margins": [0, 1], "chances": [1, 0]},
                                    {"margins": [0, 1], "chances": [0, 2]}, {"margins": [], "chances": []}, {"margins": 3, "chances": 3},
                                    {"margins": [float("nan")], "chances": [float("nan")]}])  # fmt: skip
def test_what_is_no_curve_is_refused(points):
    with pytest.raises(ValueError, match="curve of confidence"):
        ConfidenceCurve.from_json(points)


def test_the_confidence_of_a_mask_is_the_mean_chance_of_its_pixels():
    latent = np.zeros((8, 20, 2), np.float32)
    latent[:, :10, 0], latent[:, 10:] = 1, (0.8, 0.6)
    basis, vectors = Basis(np.eye(2, dtype=np.float32), 1.0), np.eye(2, dtype=np.float32)
    rgb = np.zeros((8, 20, 3), np.uint8)
    rgb[:, 10:] = 200
    curve = ConfidenceCurve((0.0, 0.5), (0.25, 0.75))
    plain, query = FrameSemantics(rgb, latent, basis), FrameSemantics(rgb, latent, basis, curve=curve)
    mask, margin = np.ones((8, 20), bool), plain.margin(vectors[0], vectors)
    assert margin[4, 2] == pytest.approx(1, abs=0.05), "as the first, and nothing of the second"
    assert margin[4, 17] == pytest.approx(0.2, abs=0.05)
    np.testing.assert_array_equal(plain.chances(vectors[0], vectors), margin)
    np.testing.assert_allclose(query.chances(vectors[0], vectors), np.interp(margin, (0, 0.5), (0.25, 0.75)), atol=1e-6)
    assert query.confidence(vectors[0], mask, vectors) == pytest.approx(query.chances(vectors[0], vectors).mean())
    assert query.confidence(vectors[0], ~mask, vectors) == 0.0
