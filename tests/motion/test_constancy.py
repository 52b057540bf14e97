"""A change of colour is told from motion and from a change of light."""

import cv2
import numpy as np
import pytest

from degense.engine.motion.constancy import (
    LARGEST_LIGHT,
    LEAST,
    LIGHT,
    SLACK,
    USUAL,
    around,
    log_intensity,
    looks_changed,
)
from degense.engine.motion.flow import sample

SHAPE = 120, 160


def tissue(seed=0, size=SHAPE):
    random = np.random.default_rng(seed)
    coarse = cv2.GaussianBlur(random.standard_normal((*size, 3)).astype(np.float32), (0, 0), 5) * 5
    fine = cv2.GaussianBlur(random.standard_normal((*size, 3)).astype(np.float32), (0, 0), 1.2) * 2
    return np.array([150, 80, 70]) + 18 * coarse + 12 * fine


def recorded(values, seed):
    noise = np.random.default_rng(seed).normal(0, 2, values.shape)
    return np.clip(np.rint(values + noise), 0, 255).astype(np.uint8)


def test_a_soft_burn_is_found_and_nothing_else():
    values = tissue()
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    burn = np.exp(-((x - 80) ** 2 + (y - 60) ** 2) / (2 * 14.0**2))[..., None]
    before, after = recorded(values, 1), recorded(values * (1 - 0.7 * burn), 2)
    changed = looks_changed(log_intensity(before), log_intensity(after), np.zeros((*SHAPE, 2), np.float32))
    assert changed[burn[..., 0] > 0.5].mean() > 0.99
    assert changed[burn[..., 0] < 0.02].mean() < 0.03
    assert around(changed)[60, 80 + 24], "beside it, matches are spoiled as well"


@pytest.mark.parametrize("gain", [1.0, 0.8, 1.15])
def test_motion_and_light_are_no_change(gain):
    values = tissue(size=(140, 180))
    slope = np.linspace(1, 0.85, 160)[:, None]  # the light falls off to one side
    before = recorded(values[10:130, 10:170], 3)
    after = recorded(gain * slope * values[13:133, 15:175], 4)
    flow = np.broadcast_to(np.float32([-5, -3]), (*SHAPE, 2)).copy()
    changed = looks_changed(log_intensity(before), log_intensity(after), flow)
    assert changed.mean() < 0.03


def test_nothing_is_known_beyond_the_frame():
    frame = log_intensity(recorded(tissue(), 5))
    assert not looks_changed(frame, frame, np.full((*SHAPE, 2), 500, np.float32)).any()


def slope(frame):
    """The steepest slope of three channels within a pixel."""
    dx, dy = (cv2.Sobel(frame, cv2.CV_64F, *order, ksize=3) / 8 for order in ((1, 0), (0, 1)))
    return cv2.dilate(np.hypot(dx, dy).max(-1), np.ones((3, 3), np.uint8))


@pytest.mark.parametrize("size", [SHAPE, (37, 61), (16, 16)])
def test_it_is_the_definition(size):
    values, random = tissue(7, size), np.random.default_rng(8)
    flow = cv2.GaussianBlur(random.normal(0, 40, (*size, 2)).astype(np.float32), (0, 0), 8)
    here, there = log_intensity(recorded(values, 9)), log_intensity(recorded(values * np.linspace(1, 0.5, size[1])[:, None], 10))
    arrived = sample(there, flow).astype(np.float64)
    known = np.isfinite(arrived[..., 0])
    assert 0 < known.mean() < 1
    ratio = np.where(known[..., None], here - arrived, 0)
    ratio -= np.median(ratio[known], axis=0)
    small = max(1, size[1] // 8), max(1, size[0] // 8)
    kept = np.dstack([np.clip(ratio, -LARGEST_LIGHT, LARGEST_LIGHT) * known[..., None], known]).astype(np.float32)
    light = cv2.GaussianBlur(cv2.resize(kept, small, interpolation=cv2.INTER_AREA), (0, 0), LIGHT * small[0])
    light = cv2.resize(light, size[::-1], interpolation=cv2.INTER_LINEAR)
    change = np.abs(ratio - light[..., :3] / np.maximum(light[..., 3:], 1e-3)).max(-1)
    slack = SLACK * np.minimum(slope(here), slope(np.where(known[..., None], arrived, here)))
    excess = np.where(known, change - (LEAST + USUAL * np.median(change[known]) + slack), -np.inf)
    found = looks_changed(here, there, flow)
    assert not (found != (excess > 0))[np.abs(excess) > 1e-5].any()
    assert found.any()
    assert not found.all()
