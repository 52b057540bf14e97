"""Points followed from one frame to another, against OpenCV and known motion."""

import cv2
import numpy as np
import pytest

from degense.engine.motion.lucas_kanade import LEVELS, ROUNDS, SIDE, STILL, Pyramid

HEIGHT, WIDTH = 120, 170


def texture(shift: tuple[float, float], size: tuple[int, int] = (WIDTH, HEIGHT)) -> np.ndarray:
    """Smooth noise, grey uint8 [H, W], moved by (x, y) pixels."""
    noise = cv2.GaussianBlur(np.random.default_rng(5).random(size[::-1]).astype(np.float32), (0, 0), 2.0)
    picture = cv2.normalize(noise, None, 20, 230, cv2.NORM_MINMAX)
    moved = cv2.warpAffine(picture, np.float32([[1, 0, shift[0]], [0, 1, shift[1]]]), size, borderMode=cv2.BORDER_REFLECT)
    return moved.round().astype(np.uint8)


@pytest.mark.parametrize("size", [(WIDTH, HEIGHT), (40, 24), (16, 16)])
def test_points_go_where_opencv_follows_them(size):
    a, b = texture((0, 0), size), texture((4.6, -3.2), size)
    rng = np.random.default_rng(0)
    places = rng.uniform((0, 0), size, (300, 2))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, ROUNDS, STILL)
    options = {"winSize": (SIDE, SIDE), "maxLevel": LEVELS - 1, "criteria": criteria}
    expected, known, _ = cv2.calcOpticalFlowPyrLK(a, b, (places - 0.5).astype(np.float32)[:, None], None, **options)
    apart = np.linalg.norm(Pyramid(a).to(Pyramid(b), places) - expected[:, 0] - 0.5, axis=1)[known[:, 0] > 0]
    assert np.median(apart) < 0.01
    assert np.quantile(apart, 0.95) < 0.1


def test_points_go_where_the_texture_moves():
    places = np.array([[60.5, 50.0], [90.2, 70.9]])
    found = Pyramid(texture((0, 0))).to(Pyramid(texture((6.4, 5.3))), places)
    np.testing.assert_allclose(found, places + np.array([6.4, 5.3]), atol=0.1)


def test_a_search_begins_at_its_guess():
    places, far = np.array([[50.0, 80.0]]), np.array([58.0, -41.0])
    a, b = Pyramid(texture((0, 0))), Pyramid(texture(far))
    np.testing.assert_allclose(a.to(b, places, places + far + np.array([3, -2])), places + far, atol=0.1)


def test_what_is_plain_or_outside_stays_where_it_was():
    plain = Pyramid(np.full((HEIGHT, WIDTH), 90, np.uint8))
    places = np.array([[60.5, 50.0], [-500.0, 1e9], [np.nan, 3.0]])
    np.testing.assert_array_equal(plain.to(plain, places), places)
