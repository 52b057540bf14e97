"""A change of colour is told from motion and from a change of light."""

import cv2
import numpy as np
import pytest

from degense.engine.motion.constancy import around, log_intensity, looks_changed

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
