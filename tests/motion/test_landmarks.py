"""Landmarks of a texture that was turned, scaled and moved by known amounts."""

import cv2
import numpy as np

from degense.engine.motion.landmarks import Landmarks, carried, landmarks, paired

HEIGHT, WIDTH = 200, 260
TURN = cv2.getRotationMatrix2D((130, 100), 25, 1.15) + np.array([[0, 0, 12], [0, 0, -9]])
PLACES = np.array([[100.0, 90.0], [150.5, 120.2], [130.0, 60.0]])


def texture() -> np.ndarray:
    noise = np.random.default_rng(1).random((HEIGHT, WIDTH)).astype(np.float32)
    blurred = sum(cv2.GaussianBlur(noise, (0, 0), sigma) * sigma for sigma in (2.0, 4.0, 8.0))
    return cv2.normalize(blurred, None, 10, 240, cv2.NORM_MINMAX).astype(np.uint8)


def turned(places: np.ndarray) -> np.ndarray:
    """Where pixel positions of the texture are in the turned one; OpenCV's whole numbers are the middles of pixels."""
    return (places - 0.5) @ TURN[:, :2].T + TURN[:, 2] + 0.5


def test_landmarks_are_known_again_and_carry_what_lies_between_them():
    a, b = texture(), cv2.warpAffine(texture(), TURN, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)
    here, there = paired(landmarks(a), landmarks(b))
    assert len(here) > 30
    assert np.mean(np.linalg.norm(turned(here) - there, axis=1) < 3) > 0.8
    np.testing.assert_allclose(carried(PLACES, (here, there)), turned(PLACES), atol=1.5)


def test_most_of_the_landmarks_around_a_place_decide():
    rng = np.random.default_rng(0)
    here = rng.uniform(40, 200, (40, 2))
    there = turned(here)
    there[::4] += rng.uniform(-60, 60, there[::4].shape)  # a quarter was paired wrongly
    np.testing.assert_allclose(carried(PLACES, (here, there)), turned(PLACES), atol=1e-9)


def test_landmarks_that_go_everywhere_carry_nothing():
    rng = np.random.default_rng(0)
    scattered = rng.uniform(0, 4000, (8, 2)), rng.uniform(0, 4000, (8, 2))
    assert np.isnan(carried(PLACES, scattered)).all()
    assert np.isnan(carried(PLACES, (PLACES[:2], PLACES[:2]))).all()
    assert carried(np.zeros((0, 2)), scattered).shape == (0, 2)


def test_a_plain_frame_has_no_landmarks():
    none = landmarks(np.full((40, 50), 90, np.uint8))
    assert none.places.shape == (0, 2)
    assert [len(ends) for ends in paired(none, landmarks(texture()))] == [0, 0]
    assert [len(ends) for ends in paired(landmarks(texture()), none)] == [0, 0]
    one = Landmarks(np.ones((1, 2)), np.ones((1, 128), np.float32))
    assert [len(ends) for ends in paired(one, one)] == [0, 0], "nothing says that another would not be as much alike"
