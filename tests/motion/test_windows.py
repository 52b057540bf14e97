"""Windows of frames around points, on textures that were moved by known offsets."""

import cv2
import numpy as np

from degense.engine.motion.window_kernels import APART, LANES, REACH, ROWS, padded
from degense.engine.motion.windows import SPREAD, Windows, windows_at

HEIGHT, WIDTH = 80, 120
PLACES = np.array([[40.3, 30.8], [70.0, 50.5], [90.6, 20.2]])
ONE = np.zeros(1, np.int64)  # the number of a frame that is alone


def texture(shift: tuple[float, float] = (0.0, 0.0), light: float = 0.0) -> np.ndarray:
    """Smooth noise uint8 [H, W, 3], moved by (x, y) pixels and made lighter by grey levels."""
    noise = cv2.GaussianBlur(np.random.default_rng(3).random((HEIGHT, WIDTH, 3)).astype(np.float32), (0, 0), 2.5)
    picture = cv2.normalize(noise, None, 40, 200, cv2.NORM_MINMAX)
    moved = cv2.warpAffine(picture, np.float32([[1, 0, shift[0]], [0, 1, shift[1]]]), (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
    return np.clip(moved + light, 0, 255).astype(np.uint8)


def grey(picture: np.ndarray) -> np.ndarray:
    return padded(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))


def kept(picture: np.ndarray) -> Windows:
    windows = Windows(len(PLACES))
    windows.keep(np.arange(len(PLACES)), grey(picture), padded(picture), PLACES)
    return windows


def test_a_window_is_looked_up_between_pixels():
    ramp = np.tile(np.arange(WIDTH, dtype=np.float32) + 0.5, (HEIGHT, 1))  # says where the middles of its pixels are
    np.testing.assert_allclose(
        windows_at(padded(ramp), PLACES)[:, 0].reshape(-1, ROWS, LANES)[..., :-1].mean((1, 2)), PLACES[:, 0], atol=0.05
    )


def test_what_was_moved_is_found_there_though_the_light_changed():
    moved, windows, lighter = PLACES + np.array([0.9, -0.6]), kept(texture()), grey(texture((0.9, -0.6), light=15))
    found = windows.matched(np.arange(3), lighter, PLACES)
    assert (np.linalg.norm(found - moved, axis=1) < 0.5 * np.linalg.norm(PLACES - moved, axis=1)).all()
    for _ in range(5):
        found = windows.matched(np.arange(3), lighter, found)
    np.testing.assert_allclose(found, moved, atol=0.15)


def test_on_a_plain_surface_nothing_moves():
    plain = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    noisy = np.clip(plain + np.random.default_rng(0).normal(0, 3, plain.shape), 0, 255).astype(np.uint8)
    found = kept(plain).matched(np.arange(3), grey(noisy), PLACES)
    np.testing.assert_allclose(found, PLACES, atol=0.2)


def test_the_right_place_is_less_unlike_than_others():
    windows, moved = kept(texture()), padded(texture((4, 3)))
    right, wrong = (windows.unlike(np.arange(3), moved[None], ONE, places[:, None])[:, 0] for places in (PLACES + np.array([4, 3]), PLACES))
    assert (right < 2).all()
    assert (wrong > 3 * right).all()


def test_unlikeness_is_a_weighted_mean_that_forgives_half_of_a_change_of_light():
    windows = kept(texture())
    np.testing.assert_allclose(windows.unlike(np.arange(3), padded(texture(light=10))[None], ONE, PLACES[:, None]), 5, atol=0.05)
    channel = texture()
    channel[..., 1] += 12
    np.testing.assert_allclose(windows.unlike(np.arange(3), padded(channel)[None], ONE, PLACES[:, None]), 12 / 3 / 2, atol=0.05)


ANYWHERE = np.array([[40.3, 30.8], [2.1, 3.3], [119.4, 79.6], [-3.0, 41.2], [60.5, 95.0], [1e12, -1e12]])


def plain(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Windows, sample by sample."""
    steps = np.arange(-REACH, REACH + 1, APART)
    height, width = image.shape[:2]
    found = []
    for x, y in np.clip(places, -1e6, 1e6):
        for down in steps:
            for across in steps:
                column, row = x + across - 0.5, y + down - 0.5
                left, above = int(np.floor(column)), int(np.floor(row))
                corners = [[image[np.clip(above + j, 0, height - 1), np.clip(left + i, 0, width - 1)] for i in (0, 1)] for j in (0, 1)]
                upper, lower = (a * (left + 1 - column) + b * (column - left) for a, b in np.array(corners, float))
                found.append(upper * (above + 1 - row) + lower * (row - above))
    return np.array(found).reshape(len(places), len(steps) ** 2, *image.shape[2:])


def test_kernels_do_what_the_formulas_say():
    picture, other = texture(), texture((1.3, -0.4), light=5)
    looked_up = windows_at(padded(picture), ANYWHERE).reshape(len(ANYWHERE), 3, ROWS, LANES)[..., :-1:APART]
    np.testing.assert_allclose(looked_up.reshape(len(ANYWHERE), 3, -1).swapaxes(1, 2), plain(picture, ANYWHERE), atol=1e-2)
    windows = Windows(9)
    rows = np.array([7, 0, 3, 4, 8, 2])
    windows.keep(rows, grey(picture), padded(picture), ANYWHERE)
    steps = np.arange(-REACH, REACH + 1, APART)
    weights = np.exp(-(steps[:, None] ** 2 + steps**2) / (2 * SPREAD**2)).ravel()
    difference = plain(other, ANYWHERE + 2) - plain(picture, ANYWHERE)
    difference -= difference.mean(1, keepdims=True) / 2
    expected = (np.abs(difference).mean(2) @ weights) / weights.sum()
    np.testing.assert_allclose(windows.unlike(rows, padded(other)[None], ONE, ANYWHERE[:, None] + 2)[:, 0], expected, rtol=1e-3, atol=1e-3)
