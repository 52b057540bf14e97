"""The light-falloff prior against walls whose depth is known."""

import cv2
import numpy as np
import pytest

from degense.engine.camera import Camera
from degense.engine.data.files.depth import STRENGTH, DepthPrior
from degense.engine.data.readers import open_clip
from tests.data.readers.makers import save

WIDTH, HEIGHT = 320, 256
CAMERA = Camera(WIDTH, HEIGHT, 250, 250, WIDTH / 2, HEIGHT / 2)
EVERYWHERE = np.ones((HEIGHT, WIDTH), bool)


def rays():
    ys, xs = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    return np.stack([(xs - CAMERA.cx) / CAMERA.fx, (ys - CAMERA.cy) / CAMERA.fy, np.ones_like(xs)], -1)


def wall(normal):
    """Depth of the plane through (0, 0, 1) with the given normal."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    return normal[2] / (rays() @ normal), normal


def lit(depth, normal, rng, gain=0.35):
    """The wall as a camera with a light at its lens sees it: inverse square, Lambert, gamma 2.2, tissue colour, sensor noise."""
    points = rays() * depth[..., None]
    distance = np.linalg.norm(points, axis=-1)
    cosine = np.abs(points @ normal) / distance
    light = gain * cosine / distance**2
    texture = 1 + 0.1 * cv2.GaussianBlur(rng.standard_normal(depth.shape), (0, 0), 1.5)
    value = 255 * np.clip(light * texture, 0, 1) ** (1 / 2.2)
    rgb = value[..., None] * np.array([1, 0.55, 0.5]) + rng.normal(0, 1.5, (*depth.shape, 3))
    return np.clip(rgb, 0, 255).astype(np.uint8)


def test_a_wall_that_faces_the_camera_is_flat():
    depth, normal = wall([0, 0, 1])
    rgb = lit(depth, normal, np.random.default_rng(1))
    found = DepthPrior([rgb], [EVERYWHERE], CAMERA).depth(rgb, EVERYWHERE, EVERYWHERE)
    assert found.dtype == np.float32
    assert np.median(found) == pytest.approx(1, abs=0.03)
    assert np.ptp(np.percentile(found, [2, 98])) < 0.06


@pytest.mark.parametrize("normal", [[0.5, 0, 1], [0, -0.5, 1], [-0.4, 0.4, 1]])
def test_a_slanting_wall_slants_the_right_way(normal):
    depth, normal = wall(normal)
    rgb = lit(depth, normal, np.random.default_rng(2))
    found = DepthPrior([rgb], [EVERYWHERE], CAMERA).depth(rgb, EVERYWHERE, EVERYWHERE)
    assert np.corrcoef(found.ravel(), depth.ravel())[0, 1] > 0.95


def test_highlights_and_dark_tools_do_not_dent_the_depth():
    rng = np.random.default_rng(3)
    depth, normal = wall([0.3, 0.1, 1])
    rgb = lit(depth, normal, rng)
    prior = DepthPrior([rgb], [EVERYWHERE], CAMERA)
    clean = prior.depth(rgb, EVERYWHERE, EVERYWHERE)
    spoiled = rgb.copy()
    for x, y in rng.integers(20, 236, (25, 2)):
        cv2.circle(spoiled, (int(x), int(y)), 3, (255, 252, 250), -1)
    cv2.line(spoiled, (WIDTH, 40), (180, 130), (46, 26, 23), 30)
    cv2.line(spoiled, (0, 200), (90, 150), (75, 76, 78), 40)
    ratio = prior.depth(spoiled, EVERYWHERE, EVERYWHERE) / clean
    assert np.percentile(np.abs(np.log(ratio)), 95) < 0.08
    assert np.abs(np.log(ratio)).max() < 0.25


def test_highlights_on_pale_tissue_do_not_dent_the_depth():
    rng = np.random.default_rng(10)
    depth, normal = wall([0, 0, 1])
    rgb = lit(depth, normal, rng)
    rgb = np.repeat(rgb.max(axis=2, keepdims=True), 3, axis=2)  # no colour to tell a highlight by
    prior = DepthPrior([rgb], [EVERYWHERE], CAMERA)
    spoiled = rgb.copy()
    cv2.circle(spoiled, (160, 120), 30, (255, 255, 255), -1)
    ratio = prior.depth(spoiled, EVERYWHERE, EVERYWHERE) / prior.depth(rgb, EVERYWHERE, EVERYWHERE)
    assert np.abs(np.log(ratio)).max() < 0.06


def test_masked_tools_take_the_depth_of_their_surroundings():
    rng = np.random.default_rng(4)
    depth, normal = wall([0, 0, 1])
    rgb = lit(depth, normal, rng)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.line(mask, (WIDTH, 100), (150, 120), 1, 40)
    rgb[mask > 0] = (240, 120, 110)  # bright and as red as tissue: only the mask tells
    usable = mask == 0
    found = DepthPrior([rgb], [usable], CAMERA).depth(rgb, usable, EVERYWHERE)
    assert np.abs(found - 1).max() < 0.12


def test_one_scale_for_all_frames():
    rng = np.random.default_rng(5)
    normal = np.array([0, 0, 1.0])
    near, far = (lit(np.full((HEIGHT, WIDTH), d), normal, rng) for d in (0.8, 1.1))
    prior = DepthPrior([near, far], [EVERYWHERE] * 2, CAMERA)
    a, b = (np.median(prior.depth(f, EVERYWHERE, EVERYWHERE)) for f in (near, far))
    assert b / a == pytest.approx((1.1 / 0.8) ** STRENGTH, rel=0.04)
    tooled = near.copy()
    tooled[:, 200:] = (12, 12, 12)
    with_tool = prior.depth(tooled, EVERYWHERE, EVERYWHERE)
    assert np.median(with_tool[:, :150]) == pytest.approx(a, rel=0.02)


def test_colour_changes_are_taken_for_albedo():
    rng = np.random.default_rng(9)
    depth, normal = wall([0.4, 0, 1])
    rgb = lit(depth, normal, rng).astype(np.float32)
    pale = cv2.GaussianBlur(np.float32(cv2.circle(np.zeros((HEIGHT, WIDTH), np.uint8), (200, 120), 60, 1, -1)), (0, 0), 2)[..., None]
    rgb = np.uint8(np.clip(rgb * (1 - pale) + rgb * np.float32([1.3, 1.7, 1.6]) * pale, 0, 255))
    found = DepthPrior([rgb], [EVERYWHERE], CAMERA).depth(rgb, EVERYWHERE, EVERYWHERE)
    flat_part = np.abs(np.log(depth)).mean()
    assert np.abs(np.log(found / depth)).mean() < flat_part
    assert found[120, 200] > 0.85 * found[120, 100:130].mean()


@pytest.mark.parametrize("value", [0, 6, 128, 255])
def test_no_shading_no_guess(value):
    rgb = np.full((HEIGHT, WIDTH, 3), value, np.uint8)
    prior = DepthPrior([rgb] * 3, [EVERYWHERE] * 3, CAMERA)
    field = EVERYWHERE.copy()
    field[:30] = False
    np.testing.assert_array_equal(prior.depth(rgb, field, field), field.astype(np.float32))
    assert prior.words.startswith("flat, not metric")


def test_a_black_frame_amid_a_clip_is_flat():
    depth, normal = wall([0.5, 0, 1])
    prior = DepthPrior([lit(depth, normal, np.random.default_rng(6))], [EVERYWHERE], CAMERA)
    black = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    assert (prior.depth(black, EVERYWHERE, EVERYWHERE) == 1).all()
    assert (prior.depth(black, ~EVERYWHERE, ~EVERYWHERE) == 0).all()


def test_noise_never_gives_what_is_not_a_depth():
    rng = np.random.default_rng(7)
    for _ in range(10):
        rgb = rng.integers(0, 256, (33, 47, 3)).astype(np.uint8)
        usable = rng.random((33, 47)) < rng.random()
        camera = Camera(47, 33, 40, 40, 23.5, 16.5)
        found = DepthPrior([rgb], [usable], camera).depth(rgb, usable, np.ones((33, 47), bool))
        assert np.isfinite(found).all()
        assert (found > 0).all()


def test_a_clip_without_depth_uses_the_prior(tmp_path):
    depth, normal = wall([0.5, 0, 1])
    rng = np.random.default_rng(8)
    for i in range(3):
        save(tmp_path / f"{i}.png", lit(depth, normal, rng))
    clip = open_clip(tmp_path)
    assert not clip.depth_measured
    assert clip.provenance["depth"].startswith("prior from light falloff, not metric")
    assert np.corrcoef(clip.depth(1).ravel(), depth.ravel())[0, 1] > 0.95
