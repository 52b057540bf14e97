"""Optical flow against known warps and against the phantom's exact motion."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import cv2
import numpy as np
import pytest

from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.motion import chain, confidence, consistent, flow_between, flow_error, follow, normalized, sample, steps_between
from degense.engine.motion.flow import even
from tests.data.synthetic.files import load


def texture(rng, height=120, width=160):
    noise = sum(cv2.GaussianBlur(rng.standard_normal((height, width, 3)).astype(np.float32), (0, 0), s) * s for s in (1.5, 4, 9))
    return np.clip(128 + 45 * noise / noise.std(), 0, 255).astype(np.uint8)


def shifted(image, dx, dy):
    return cv2.warpAffine(image, np.float32([[1, 0, dx], [0, 1, dy]]), image.shape[1::-1], borderMode=cv2.BORDER_REFLECT)


def test_translation_is_found_with_its_sign():
    image = texture(np.random.default_rng(1))
    flow = flow_between(image, shifted(image, 3.5, -2.0))
    error = np.linalg.norm(flow - [3.5, -2.0], axis=-1)[12:-12, 12:-12]
    assert np.median(error) < 0.1
    assert np.percentile(error, 95) < 0.4


def test_light_that_changes_is_no_motion():
    image = texture(np.random.default_rng(2))
    x = np.linspace(0.55, 1.0, image.shape[1])[None, :, None]
    flow = flow_between(image, (image * x).astype(np.uint8))
    assert np.percentile(np.linalg.norm(flow, axis=-1), 95) < 0.3


def test_smoke_that_drifts_is_no_motion_of_tissue():
    """Tissue slides to the right, smoke over it faster to the left: what is followed, with normalized contrast, is the tissue."""
    rng = np.random.default_rng(4)
    tissue, puffs = texture(rng, 120, 200), cv2.GaussianBlur(rng.random((120, 260)).astype(np.float32), (0, 0), 9)
    puffs = 0.5 * cv2.normalize(puffs, None, 0, 1, cv2.NORM_MINMAX)[..., None]

    def frame(t: int) -> np.ndarray:
        veil = puffs[:, 4 * t : 4 * t + 160]
        return ((1 - veil) * tissue[:, 20 - t : 180 - t] + 215 * veil).astype(np.uint8)

    frames = [frame(t) for t in range(8)]
    errors = {}
    for grey in (even, normalized):
        out, _ = list(follow(frames, grey=grey))[-1]
        errors[grey] = np.linalg.norm(out - [7, 0], axis=-1)[12:-12, 12:-12].mean()
    assert errors[normalized] < 0.25
    assert errors[normalized] < 0.5 * errors[even]


def test_what_is_normalized_has_neither_brightness_nor_contrast():
    image = texture(np.random.default_rng(6))
    fainter = (0.5 * image + 60).astype(np.uint8)
    assert np.abs(normalized(image).astype(int) - normalized(fainter)).mean() < 3
    assert np.abs(even(image).astype(int) - even(fainter)).mean() > 5
    assert np.ptp(normalized(np.full((20, 30, 3), 90, np.uint8))) == 0
    assert normalized(np.zeros((16, 16, 3), np.uint8)).shape == (16, 16)


def test_an_initial_guess_is_taken_and_left_unchanged():
    image = texture(np.random.default_rng(3))
    moved = np.roll(image, 45, axis=1)
    guess = np.zeros((*image.shape[:2], 2), np.float32)
    guess[..., 0] = 44
    kept = guess.copy()
    flow = flow_between(image, moved, guess)
    np.testing.assert_array_equal(guess, kept)
    inside = np.s_[12:-12, 12:-60]
    assert np.median(np.linalg.norm(flow[inside] - [45, 0], axis=-1)) < 0.2


def test_frames_of_different_size_are_refused():
    with pytest.raises(ValueError, match="differ in size"):
        flow_between(np.zeros((32, 32, 3), np.uint8), np.zeros((32, 40, 3), np.uint8))


def test_flow_is_safe_in_threads():
    rng = np.random.default_rng(4)
    images = [texture(rng) for _ in range(6)]
    pairs = list(pairwise(images)) * 3
    alone = [flow_between(a, b) for a, b in pairs]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda pair: flow_between(*pair), pairs))
    assert all(np.array_equal(a, b) for a, b in zip(alone, together, strict=True))


def test_sample_and_chain_match_a_loop():
    rng = np.random.default_rng(5)
    first = rng.uniform(-6, 6, (14, 17, 2)).astype(np.float32)
    second = rng.uniform(-6, 6, (14, 17, 2)).astype(np.float32)
    result = chain(first, second)
    for y in range(14):
        for x in range(17):
            px, py = x + first[y, x, 0], y + first[y, x, 1]
            if not (0 <= px <= 16 and 0 <= py <= 13):
                assert np.isnan(result[y, x]).all()
                continue
            ix, iy = min(int(px), 15), min(int(py), 12)
            wx, wy = px - ix, py - iy
            corners = second[iy, ix] * (1 - wx) * (1 - wy) + second[iy, ix + 1] * wx * (1 - wy)
            corners = corners + second[iy + 1, ix] * (1 - wx) * wy + second[iy + 1, ix + 1] * wx * wy
            # OpenCV rounds weights to 1/32.
            np.testing.assert_allclose(result[y, x], first[y, x] + corners, atol=0.45)
    assert np.isnan(sample(np.ones((14, 17)), np.full((14, 17, 2), np.nan))).all()


def test_consistency_of_exact_opposites_and_of_disagreement():
    forward = np.zeros((40, 50, 2), np.float32)
    forward[..., 0] = 5.0
    agrees = consistent(forward, -forward)
    assert agrees[:, :44].all()
    assert not agrees[:, 46:].any(), "the way leaves the image"
    assert not consistent(forward, forward)[:, :44].any()
    off = -forward + np.float32([0.5, 0])
    assert consistent(forward, off)[:, :44].all()
    assert not consistent(forward, off, tolerance=0.1, share=0.0)[:, :44].any()
    assert not consistent(np.full_like(forward, np.nan), -forward).any()


def test_hidden_points_are_inconsistent():
    rng = np.random.default_rng(6)
    image, patch = texture(rng), texture(rng, 60, 50)
    before, after = image.copy(), image.copy()
    before[30:90, 20:70], after[30:90, 60:110] = patch, patch
    believed = consistent(flow_between(before, after), flow_between(after, before))
    assert believed[10:110, 125:150].mean() > 0.95
    assert believed[36:84, 76:106].mean() < 0.35, "covered in the second frame"


def test_confidence_is_low_on_plain_surfaces_and_straight_edges():
    rng = np.random.default_rng(7)
    image = texture(rng, 120, 240)
    image[:, 80:160] = 120
    image[:, 160:] = np.where(np.arange(80)[None, :, None] < 40, 60, 190)
    noisy = np.clip(image + rng.normal(0, 1.5, image.shape), 0, 255).astype(np.uint8)
    sure = confidence(noisy)
    assert sure.min() >= 0
    assert sure.max() <= 1
    assert np.median(sure[10:-10, 10:70]) > 0.9
    assert np.median(sure[10:-10, 90:150]) < 0.3
    assert np.median(sure[10:-10, 198:202]) < 0.3


def test_the_error_that_noise_makes_grows_with_noise_and_with_plainness():
    rng = np.random.default_rng(8)
    still = np.full((96, 288, 3), 110.0)
    for part, contrast in enumerate((0.6, 0.2, 0.05)):
        still[:, 96 * part : 96 * (part + 1)] += contrast * (texture(rng, 96, 96) - 110.0)

    def noisy(sigma):
        return np.clip(still + rng.normal(0, sigma, (*still.shape[:2], 1)), 0, 255).astype(np.uint8)

    for sigma in (2.0, 4.0):
        found = np.linalg.norm(flow_between(noisy(sigma), noisy(sigma)), axis=-1)
        said = flow_error(noisy(sigma))
        parts = [np.s_[10:-10, 96 * part + 12 : 96 * part + 84] for part in range(3)]
        told, true = ([float(np.median(values[part])) for part in parts] for values in (said, found))
        assert told[0] < told[1] < told[2]
        assert true[0] < true[1] < true[2]
        assert 0.2 < true[0] / told[0] < 1


@pytest.fixture(scope="module")
def phantom(tmp_path_factory):
    out = tmp_path_factory.mktemp("flow") / "clip"
    make_phantom(out, PhantomOptions(frames=24, width=200, height=160, seed=11))
    return load(out)


def test_steps_are_measured_a_few_ahead_and_are_those_of_each_pair():
    images = [texture(np.random.default_rng(8), 48, 64)]
    images += [shifted(images[0], i, 0) for i in range(1, 30)]
    read = []
    steps = steps_between((read.append(i) or image for i, image in enumerate(images)), threads=2)
    first = next(steps)
    assert len(read) <= 7, "a long clip is never in memory as a whole"
    for (there, back), a, b in zip([first, *steps], images[:-1], images[1:], strict=True):
        assert np.array_equal(there, flow_between(a, b))
        assert np.array_equal(back, flow_between(b, a))


def test_follow_measures_the_phantoms_motion(phantom):
    flows = list(follow(phantom.images))
    assert len(flows) == len(phantom.images) - 1
    y, x = np.indices(phantom.labels.shape[1:]) + 0.5
    here = np.stack([x, y], -1)
    for frame in (4, 12, 23):
        out, back = flows[frame - 1]
        landed, _ = phantom.pixels(phantom.world(frame) - phantom.displacement[frame], 0)
        truth = landed - here
        tissue = np.isfinite(truth).all(-1) & ~phantom.cautery[frame]
        believed = consistent(back, out) & tissue
        error = np.linalg.norm(back - truth, axis=-1)
        assert believed.sum() > 0.85 * tissue.sum()
        assert np.mean(error[believed]) < 0.3
    moving = believed & (np.linalg.norm(truth, axis=-1) > 5)
    assert moving.sum() > 600
    assert np.median(error[moving]) < 1.2
    direct = np.linalg.norm(flow_between(phantom.images[23], phantom.images[0]) - truth, axis=-1)
    assert np.median(error[moving]) < 0.5 * np.median(direct[moving]), "following beats matching the far frames directly"


def test_noise_does_not_choose_between_the_chained_flow_and_the_search():
    """Noisy frames of a still texture: of two flows that explain noise alike, the better in each pixel is the rougher (mean 0.33)."""
    rng = np.random.default_rng(8)
    still = cv2.GaussianBlur(rng.normal(size=(120, 160, 3)).astype(np.float32), (0, 0), 4)
    still = 128 + 20 * still / still.std()
    frames = [np.clip(still + rng.normal(scale=3, size=still.shape), 0, 255).astype(np.uint8) for _ in range(10)]
    _, back = list(follow(frames))[-1]
    assert np.linalg.norm(back, axis=-1).mean() < 0.31


def test_more_smoothness_is_more_exact_in_noise():
    rng = np.random.default_rng(9)
    still = cv2.GaussianBlur(rng.normal(size=(120, 160, 3)).astype(np.float32), (0, 0), 3)
    still = 128 + 10 * still / still.std()
    slides = [cv2.warpAffine(still, np.float32([[1, 0, 0.5 * i], [0, 1, 0]]), (160, 120), borderMode=cv2.BORDER_REFLECT) for i in range(6)]
    frames = [np.clip(frame + rng.normal(size=still.shape), 0, 255).astype(np.uint8) for frame in slides]
    usual, smooth = (list(follow(frames, grey=normalized, smoothness=weight))[-1][1] for weight in (20.0, 40.0))
    inside = np.s_[12:-12, 12:-12]
    error, smooth_error = (np.linalg.norm(flow - (-2.5, 0), axis=-1)[inside].mean() for flow in (usual, smooth))
    assert smooth_error < 0.9 * error < 0.1
