"""The curve from margins to chances: fitted, drawn on masks, and refused where it is none."""

from dataclasses import replace

import numpy as np
import pytest

from degense.engine.semantics.basis import Basis
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.masks.confidence import BINS, ConfidenceCurve
from degense.engine.semantics.prompts import PromptVectors


def test_a_curve_finds_the_chances_that_its_pixels_were_drawn_with():
    random = np.random.default_rng(0)
    margin = random.uniform(0, 1, 200_000)
    right = random.random(len(margin)) < np.sqrt(margin)
    place = (margin * BINS).astype(int)
    curve = ConfidenceCurve.fitted(*(np.bincount(place, weight, BINS) for weight in (None, margin, right)))
    asked = np.linspace(0.05, 0.95, 19)
    np.testing.assert_allclose(curve(asked), np.sqrt(asked), atol=0.03)
    assert ConfidenceCurve.from_json(curve.to_json()) == curve
    assert ConfidenceCurve.from_json({name: curve.to_json()[name] for name in ("margins", "chances")}) == curve, "of an earlier version"


def test_estimates_that_fall_or_exceed_all_are_mended():
    pixels = np.array([10.0, 0, 10, 20])
    curve = ConfidenceCurve.fitted(pixels, pixels * [0.1, 0, 0.5, 0.9], np.array([5.0, 0, 3, 22]))
    assert curve.margins == pytest.approx((0.1, 0.5, 0.9))
    assert curve.chances == pytest.approx((0.4, 0.4, 1.0))
    with pytest.raises(ValueError, match="no pixels"):
        ConfidenceCurve.fitted(np.zeros(3), np.zeros(3), np.zeros(3))


@pytest.mark.parametrize("points", [{}, {"margins": [0, 0], "chances": [0, 1]}, {"margins": [0, 1], "chances": [1, 0]},
                                    {"margins": [0, 1], "chances": [0, 2]}, {"margins": [], "chances": []}, {"margins": 3, "chances": 3},
                                    {"margins": [float("nan")], "chances": [float("nan")]},
                                    {"margins": [0], "chances": [1], "sizes": [-9, -3], "discounts": [0.5, 0.2]}])  # fmt: skip
def test_what_is_no_curve_is_refused(points):
    with pytest.raises(ValueError, match="curve of confidence"):
        ConfidenceCurve.from_json(points)


def test_small_objects_are_discounted_as_often_as_they_are_wrong():
    random = np.random.default_rng(0)
    shares = 2.0 ** random.uniform(-13, -2, 4000)
    right = (random.random(len(shares)) < np.where(shares < 2**-10, 0.3, 0.8)).astype(float)
    curve = ConfidenceCurve((0.0,), (0.8,)).with_objects(shares, np.full(len(shares), 0.8), right)
    asked = np.array([2.0**-12, 2.0**-5])
    np.testing.assert_allclose(curve.of_objects(np.array([0.8, 0.8]), asked), (0.3, 0.8), atol=0.05)
    assert curve.least == 2.0**-10, "up to where they are oftener wrong than right"
    assert ConfidenceCurve.from_json(curve.to_json()) == curve
    few = ConfidenceCurve((0.0,), (0.8,)).with_objects(np.array([2.0**-12]), np.array([0.8]), np.zeros(1))
    assert few.least == 0.0, "one object is no evidence"
    bad = ConfidenceCurve((0.0,), (0.8,)).with_objects(np.full(99, 0.3), np.full(99, 0.8), np.zeros(99))
    assert bad.least == 1e-2, "what is large stays"


def test_a_mask_is_as_right_as_its_objects_and_loses_those_that_are_oftener_wrong():
    latent = np.zeros((64, 64, 2), np.float32)
    latent[..., 0] = 1
    latent[20:50, 20:50] = latent[4:7, 4:7] = (0, 1)
    basis, vectors, rgb = Basis(np.eye(2, dtype=np.float32), 1.0), np.eye(2, dtype=np.float32), np.zeros((64, 64, 3), np.uint8)
    rgb[20:50, 20:50] = rgb[4:7, 4:7] = 200
    asked = PromptVectors(tuple(vectors), classes=vectors)
    curve = ConfidenceCurve((0.0,), (0.9,), (-12.0, -6.0), (0.2, 1.0))
    query = FrameSemantics(rgb, latent, basis, curve=curve)
    mask = query.decode(asked).masks[1]
    small, large = mask[:10].sum(), mask[10:].sum()
    assert small > 0
    expected = 0.9 * (small * np.interp(np.log2(small / 64**2), (-12, -6), (0.2, 1)) + large) / (small + large)
    assert query.confidence(vectors[1], mask, vectors) == pytest.approx(expected, abs=1e-4)
    sure = FrameSemantics(rgb, latent, basis, curve=replace(curve, least=2.0**-8)).decode(asked).masks[1]
    np.testing.assert_array_equal(sure, mask & (np.arange(64)[:, None] >= 10))


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
