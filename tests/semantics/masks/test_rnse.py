"""Region aggregation: its quantities by loops, noise and specks removed, instruments of any width kept, and the twin on tensors."""

import cv2
import numpy as np
import pytest
import torch

from degense.engine.metrics.masks import boundary_f, iou
from degense.engine.research.bench.mask_scenes import DEGRADATIONS, hand_frame, phantom_frame
from degense.engine.semantics import EmbeddedEncoder, fit_basis
from degense.engine.semantics.masks import FrameSemantics, rnse, rnse_torch, superpixels
from degense.engine.semantics.masks.guided_filter import RADIUS, GuidedFilter
from degense.engine.semantics.masks.rnse_cpu import CpuAggregation, frame_statistics
from degense.engine.semantics.masks.similarity import normalised
from degense.engine.semantics.masks.superpixels_torch import superpixels_on_device
from degense.engine.semantics.prompts import DECODERS
from tests.semantics.masks.scenes import labels_of, latents, mask_of, overlap, scene

FRAMES = {
    "phantom": lambda seed: phantom_frame(160, 128, seed, 0.5),
    "hand-made": lambda seed: hand_frame(240, 192, seed),
    "pale": lambda seed: hand_frame(240, 192, seed, contrast=0.2),
    "one and two pixels": lambda seed: hand_frame(240, 192, seed, widths=(1, 1, 2, 2)),
}
TOOLS = ("grasper", "L-hook electrocautery")


def asked(frame, degradation, seed=0, tensors=False):
    vectors = EmbeddedEncoder(frame.classes).encode(frame.classes)
    basis = fit_basis(vectors, np.ones(len(vectors)))
    latent = DEGRADATIONS[degradation].apply(frame.labels, basis.project(vectors), seed)
    picture = (torch.from_numpy(frame.rgb), torch.from_numpy(latent)) if tensors else (frame.rgb, latent)
    return FrameSemantics(*picture, basis), vectors


def ramp(value, ends):
    return min(max((value - ends[0]) / (ends[1] - ends[0]), 0.0), 1.0)


def angle(a, b):
    return a @ b / max(np.linalg.norm(a) * np.linalg.norm(b), 1e-12)


def test_statistics_match_the_formulas():
    frame = hand_frame(60, 44, 0, widths=(2, 3))
    latent = DEGRADATIONS["noisy"].apply(frame.labels, np.eye(4, dtype=np.float32), 0)
    latent[:, :30] = np.eye(4, dtype=np.float32)[frame.labels[:, :30]]
    row, column = np.argwhere(cv2.erode((frame.labels[:, :30] != 3).astype(np.uint8), np.ones((25, 25)), borderValue=0) > 0)[0]
    latent[row, column] = [0, 0, 0, 1]
    unit = normalised(latent)
    regions = superpixels(frame.rgb)
    found = frame_statistics(unit, regions)
    z = unit.astype(float)
    height, width = regions.shape

    def at(y, x):
        return z[min(max(y, 0), height - 1), min(max(x, 0), width - 1)]

    rough = np.empty(regions.shape)
    for y, x in np.ndindex(*regions.shape):
        steps = [(0, 2), (2, 0), (2, 2), (2, -2)]
        rough[y, x] = min(np.linalg.norm(at(y - v, x - u) - 2 * z[y, x] + at(y + v, x + u)) for v, u in steps) / np.sqrt(6)
    noise = [np.exp(np.log(rough[regions == k] + rnse.QUIET).mean()) for k in range(regions.max() + 1)]
    raised = np.array([ramp(v, rnse.NOISE) for v in noise])[regions]
    noisiness = cv2.blur(raised, (7, 7), borderType=cv2.BORDER_REPLICATE)
    means = []
    for k in range(regions.max() + 1):
        members = z[regions == k]
        weights = np.array([ramp(angle(m, members.mean(0)), rnse.MAJORITY) + 1e-3 for m in members])
        means.append((weights[:, None] * members).sum(0) / weights.sum())
    np.testing.assert_allclose(found.means, means, atol=1e-5)
    local = cv2.blur(z, (3, 3), borderType=cv2.BORDER_REPLICATE)
    smooth = z + noisiness[..., None] * (local - z)
    agreement, specks = np.empty(regions.shape), np.empty(regions.shape)
    for y, x in np.ndindex(*regions.shape):
        agreement[y, x] = ramp(angle(smooth[y, x], means[regions[y, x]]), rnse.AGREEMENT)
        r = rnse.REACH
        square = [(v, u) for v in range(-r, r + 1) for u in range(-r, r + 1) if max(abs(v), abs(u)) == r]
        inside = [(y + v, x + u) for v, u in square if 0 <= y + v < height and 0 <= x + u < width]
        goes_on = sum(ramp(angle(smooth[y, x], smooth[q]), rnse.ALIKE) for q in inside)
        specks[y, x] = (1 - agreement[y, x]) * (1 - min(goes_on, 1))
    noisiness = np.maximum(noisiness, np.minimum(1, rnse.SPECK_GAIN * cv2.blur(specks, (9, 9), borderType=cv2.BORDER_REPLICATE)))
    np.testing.assert_allclose(found.noisiness, noisiness, atol=1e-3)
    np.testing.assert_allclose(found.weight, noisiness * agreement + specks, atol=1e-3)
    assert specks[row, column] > 0.9
    assert raised.min() == 0
    assert raised.max() == 1


def test_where_latents_are_noisy_the_coarse_map_is_equation_4():
    rgb, labels = scene(120, 90)
    unit = normalised(latents(np.zeros_like(labels), np.eye(4, dtype=np.float32), 0, 0.3, 0))
    aggregation = CpuAggregation(rgb, unit)
    sure = aggregation.statistics.weight > 0.999
    assert sure.mean() > 0.9
    query = np.array([[0.8, 0.6, 0, 0]])
    (coarse,), (pixel,) = aggregation.coarse(query), aggregation.similarity(query)
    for k in range(aggregation.regions.max() + 1):
        inside = aggregation.regions == k
        region = aggregation.statistics.means[k] @ query[0]
        np.testing.assert_allclose(coarse[inside & sure], region, atol=2e-3)
        assert region == pytest.approx(pixel[inside].mean(), abs=0.05)  # its stragglers count less


def reference_guided_filter(guide, image, radius, flat):
    """He et al. 2013 in float64, colour guidance in [0, 1]; and the windows' mean R²."""

    def mean(x):
        return cv2.boxFilter(x, -1, (2 * radius + 1,) * 2, borderType=cv2.BORDER_REPLICATE)

    guide, image = guide.astype(np.float64) / 255, image.astype(np.float64)
    mu, nu = mean(guide), mean(image)
    covariance = mean(guide * image[..., None]) - mu * nu[..., None]
    products = [[mean(guide[..., i] * guide[..., j]) - mu[..., i] * mu[..., j] for j in range(3)] for i in range(3)]
    slope = np.linalg.solve(np.moveaxis(np.array(products), (0, 1), (2, 3)) + flat * np.eye(3), covariance[..., None])[..., 0]
    offset = nu - (slope * mu).sum(-1)
    explained = np.clip((slope * covariance).sum(-1) / np.maximum(mean(image**2) - nu**2, rnse.LEVEL), 0, 1)
    return (mean(slope) * guide).sum(-1) + mean(offset), mean(explained)


def test_guided_filter_is_the_published_one():
    rgb, labels = scene(160, 120, seed=2)
    image = normalised(latents(labels, np.eye(4, dtype=np.float32)))[..., 3]
    found = GuidedFilter(rgb, rnse.FLAT, rnse.LEVEL)(np.ascontiguousarray(image)[None])
    for ours, expected in zip(found, reference_guided_filter(rgb, image, RADIUS, rnse.FLAT), strict=True):
        np.testing.assert_allclose(ours[0], expected, atol=1e-3)


@pytest.mark.parametrize("degradation", DEGRADATIONS)
@pytest.mark.parametrize("kind", FRAMES)
def test_instruments_lose_nothing(kind, degradation):
    """Against plain threshold and argmax, over seeds, label maps and single prompts; half a percent of IoU is noise."""
    scores = {}
    for seed in range(3):
        frame = FRAMES[kind](seed)
        query, vectors = asked(frame, degradation, seed)
        for decoder in DECODERS:
            labels = labels_of(query, vectors, decoder)
            for c in (frame.classes.index(name) for name in TOOLS if name in frame.classes):
                truth = frame.labels == c
                if truth.sum() >= 30:
                    mask = mask_of(query, vectors[c], decoder, classes=vectors)
                    scores.setdefault(decoder, []).append((iou(labels == c, truth), boundary_f(labels == c, truth, 2), iou(mask, truth)))
    mean = {decoder: np.mean(values, 0) for decoder, values in scores.items()}
    for plain in ("threshold", "argmax"):
        assert mean["rnse"][0] >= mean[plain][0] - 0.005
        if (kind, degradation) != ("one and two pixels", "noisy"):  # noise fattens the plain masks' lines, whose outline then counts as met
            assert mean["rnse"][1] >= mean[plain][1] - 0.015
    assert mean["rnse"][2] >= mean["threshold"][2] - 0.005
    assert mean["rnse+argmax"][2] >= mean["argmax"][2] - 0.005
    if degradation == "exact":
        assert mean["rnse"][0] > 0.995
    if degradation == "all":  # and where there is something to repair, it is repaired
        assert mean["rnse"][0] > mean["argmax"][0] + 0.05


@pytest.mark.parametrize("seed", [0, 1])
def test_specks_go_and_thin_instruments_stay(seed):
    rgb, labels = scene(320, 256, seed)
    basis = np.eye(4, dtype=np.float32)
    for specks, noise in ((0.0, 0.0), (0.004, 0.05)):
        aggregation = CpuAggregation(rgb, latents(labels, basis, 0.0, noise, specks, seed))
        maps = zip(aggregation.similarity(basis), aggregation.refined(basis), strict=True)
        for c, (pixel, refined) in enumerate(maps):
            assert overlap(refined > 0.5, labels == c) >= overlap(pixel > 0.5, labels == c) - 0.005
            if specks:
                assert overlap(refined > 0.5, labels == c) > 0.97


def test_plain_averaging_would_lose_the_instruments():
    # the reason for all this: Eq. 4 alone on regions that are larger than the instrument is wide
    frame = hand_frame(240, 192, 0, contrast=0.0)
    basis = np.eye(4, dtype=np.float32)
    aggregation = CpuAggregation(frame.rgb, basis[frame.labels])
    counts = np.bincount(aggregation.regions.ravel())
    plain = (np.bincount(aggregation.regions.ravel(), (frame.labels == 3).ravel()) / counts)[aggregation.regions] > 0.5
    (kept,) = aggregation.refined(basis[3:])
    assert overlap(kept > 0.5, frame.labels == 3) > 0.99 > overlap(plain, frame.labels == 3) + 0.3


@pytest.mark.parametrize("tensors", [False, True])
def test_rnse_paper_is_equation_4_guided_and_a_threshold(tensors):
    """Against loops over superpixels in float64: no weights by opacity, no rivals, no cleaning."""
    frame = hand_frame(120, 96, 3)
    vectors = np.eye(5, dtype=np.float32)[:4]
    basis = fit_basis(vectors, np.ones(4))
    latent = DEGRADATIONS["all"].apply(frame.labels, basis.project(vectors), 1)
    alpha = np.random.default_rng(0).uniform(0.2, 1, frame.labels.shape).astype(np.float32)
    arrays = frame.rgb, latent, alpha
    rgb, values, opacity = map(torch.from_numpy, arrays) if tensors else arrays
    query = FrameSemantics(rgb, values, basis, opacity)
    unit = latent.astype(np.float64) / np.linalg.norm(latent.astype(np.float64), axis=2, keepdims=True)
    regions = query._aggregation.regions
    for vector in vectors:
        cosine = unit @ basis.project(vector[None])[0].astype(np.float64)
        coarse = np.zeros_like(cosine)
        for k in range(regions.max() + 1):
            coarse[regions == k] = cosine[regions == k].mean()
        expected, _ = reference_guided_filter(frame.rgb, coarse, RADIUS, rnse.FLAT)
        found = query.read(vector, "mean")
        np.testing.assert_allclose(found, expected, atol=2e-3)
        mask = mask_of(query, vector, "rnse-paper", 0.5, classes=vectors)
        np.testing.assert_array_equal(mask, found > 0.5)
        assert 0 < mask.sum() < mask.size


# -- the twin on tensors -------------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 2), (50, 61)])
def test_tensors_give_the_same_superpixels(shape):
    rgb = cv2.blur(np.random.default_rng(0).integers(0, 256, (*shape, 3)).astype(np.uint8), (3, 3)).reshape(*shape, 3)
    expected = superpixels(rgb)
    found, count = superpixels_on_device(torch.from_numpy(rgb))
    assert found.max() < count
    assert np.mean(rnse_torch.dense(found.numpy().astype(np.int32), count) == expected) > 0.999


@pytest.mark.parametrize("degradation", DEGRADATIONS)
def test_tensors_give_the_same_answers(degradation):
    frame = phantom_frame(160, 128, 3, 0.5)
    (here, vectors), (there, _) = (asked(frame, degradation, 0, tensors) for tensors in (False, True))
    for c in range(len(vectors)):
        np.testing.assert_allclose(there.similarity(vectors[c]), here.similarity(vectors[c]), atol=1e-5)
        assert np.mean(np.abs(there.refined(vectors[c]) - here.refined(vectors[c])) < 1e-3) > 0.999
    for decoder in DECODERS:
        assert np.mean(labels_of(there, vectors, decoder) == labels_of(here, vectors, decoder)) >= 0.999
        masks = (mask_of(query, vectors[0], decoder, classes=vectors) for query in (there, here))
        assert np.mean(np.equal(*masks)) >= 0.999
