"""Region aggregation: Eq. 4 by loops, noise removed, thin instruments kept."""

import cv2
import numpy as np
import pytest

from engine.masks import rnse
from engine.masks.bench import latents, overlap, scene
from engine.masks.rnse import RegionAggregation
from engine.masks.similarity import cosine, normalised


def random_frame(seed, shape=(30, 44), channels=3):
    rng = np.random.default_rng(seed)
    rgb = cv2.GaussianBlur(rng.integers(0, 256, (*shape, 3)).astype(np.uint8), (0, 0), 2)
    query = rng.normal(size=channels)
    return rgb, normalised(rng.normal(size=(*shape, channels)).astype(np.float32)), query / np.linalg.norm(query)


def test_coarse_map_matches_the_formula():
    rgb, unit, query = random_frame(0)
    aggregation = RegionAggregation(rgb, unit)
    coarse = aggregation.coarse(query)
    padded = np.pad(unit.astype(float), ((1, 1), (1, 1), (0, 0)), mode="edge")
    seen = set()
    for y in range(30):
        for x in range(44):
            members = (
                [(i, j) for i in range(30) for j in range(44) if aggregation.regions[i, j] == aggregation.regions[y, x]]
                if x % 9 == 0
                else None
            )
            if members is None:
                continue
            region_cosine = np.mean([unit[i, j] @ query for i, j in members])  # Eq. 4
            region_mean = np.mean([unit[i, j] for i, j in members], axis=0)
            local = padded[y : y + 3, x : x + 3].mean((0, 1))
            agreement = local @ region_mean / (np.linalg.norm(local) * np.linalg.norm(region_mean))
            w = min(max((agreement - rnse.TRUST_PIXEL) / (rnse.TRUST_REGION - rnse.TRUST_PIXEL), 0), 1)
            assert coarse[y, x] == pytest.approx(w * region_cosine + (1 - w) * (unit[y, x] @ query), abs=1e-4)
            seen.add(0 if w == 0 else 1 if w == 1 else 2)
    assert {0, 2} <= seen


def test_where_regions_are_trusted_the_map_is_equation_4():
    rgb, labels = scene(120, 90)
    unit = normalised(latents(np.zeros_like(labels), np.eye(4, dtype=np.float32), 0, 0.1, 0))
    aggregation = RegionAggregation(rgb, unit)
    assert (aggregation.trust == 1).all()
    query = np.array([0.8, 0.6, 0, 0])
    pixel = cosine(unit, query)
    for k in range(aggregation.regions.max() + 1):
        inside = aggregation.regions == k
        np.testing.assert_allclose(aggregation.coarse(query)[inside], pixel[inside].mean(), atol=1e-5)


def reference_guided_filter(guide, image, radius, flat):
    """He et al. 2013 in float64, colour guidance in [0, 1]."""

    def mean(x):
        return cv2.boxFilter(x, -1, (2 * radius + 1,) * 2, borderType=cv2.BORDER_REFLECT)

    guide, image = guide.astype(np.float64) / 255, image.astype(np.float64)
    mu, nu = mean(guide), mean(image)
    covariance = mean(guide * image[..., None]) - mu * nu[..., None]
    products = [[mean(guide[..., i] * guide[..., j]) - mu[..., i] * mu[..., j] for j in range(3)] for i in range(3)]
    slope = np.linalg.solve(np.moveaxis(np.array(products), (0, 1), (2, 3)) + flat * np.eye(3), covariance[..., None])[..., 0]
    offset = nu - (slope * mu).sum(-1)
    return (mean(slope) * guide).sum(-1) + mean(offset)


def test_guided_filter_is_the_published_one():
    # OpenCV's float path zeroes the slope of nearly singular windows; this is what would notice
    rgb, labels = scene(160, 120, seed=2)
    unit = normalised(latents(labels, np.eye(4, dtype=np.float32)))
    aggregation = RegionAggregation(rgb, unit)
    query = np.array([0, 0, 0, 1.0])
    expected = reference_guided_filter(rgb, aggregation.coarse(query), rnse.RADIUS, rnse.FLAT)
    np.testing.assert_allclose(aggregation.refined(query), expected, atol=2e-3)


@pytest.mark.parametrize("seed", [0, 1])
def test_specks_go_and_thin_instruments_stay(seed):
    rgb, labels = scene(320, 256, seed)
    basis = np.eye(4, dtype=np.float32)
    for specks, noise in ((0.0, 0.0), (0.004, 0.05)):
        unit = normalised(latents(labels, basis, 0.0, noise, specks, seed))
        aggregation = RegionAggregation(rgb, unit)
        for c in range(4):
            pixelwise = overlap(cosine(unit, basis[c]) > 0.5, labels == c)
            regional = overlap(aggregation.refined(basis[c]) > 0.5, labels == c)
            assert regional >= pixelwise - 0.01
            if specks:
                assert regional > 0.98


def test_plain_averaging_would_lose_the_instruments():
    # the reason for `trust`: Eq. 4 alone on regions that are larger than the instrument is wide
    rgb, labels = scene(320, 256, 0)
    rgb = cv2.GaussianBlur(rgb, (0, 0), 4)  # a picture that does not show the instrument's edge
    basis = np.eye(4, dtype=np.float32)
    aggregation = RegionAggregation(rgb, normalised(latents(labels, basis, 0.0, 0.0, 0.0)))
    plain = (aggregation.means @ basis[3])[aggregation.regions] > 0.5
    kept = aggregation.coarse(basis[3]) > 0.5
    assert overlap(kept, labels == 3) > 0.9 > overlap(plain, labels == 3) + 0.2
