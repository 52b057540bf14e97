"""Points followed by optical flow alone, on a texture whose motion is known."""

import cv2
import numpy as np

from degense.engine.motion.points import following_pixels
from degense.engine.progress import finish

FRAMES, WIDTH, HEIGHT = 7, 120, 90


def sliding(frame: int) -> np.ndarray:
    """A texture that goes 2 pixels to the right and 1 down a frame; from frame 5 on a grey plate covers its right half."""
    noise = np.random.default_rng(0).random((HEIGHT + 40, WIDTH + 40, 3)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    picture = texture[20 - frame : 20 - frame + HEIGHT, 20 - 2 * frame : 20 - 2 * frame + WIDTH].copy()
    if frame >= 5:
        picture[:, WIDTH // 2 :] = 120
    return picture


def test_points_are_followed_both_ways_from_their_own_frames():
    queries = np.array([[0, 30.0, 40.0], [3, 40.0, 50.0]])
    pixels, seen = finish(following_pixels(sliding, FRAMES, queries))
    assert pixels.shape == (2, FRAMES, 2)
    for k, (start, x, y) in enumerate(queries):
        right = np.array([[x + 2 * (t - start), y + (t - start)] for t in range(5)])
        np.testing.assert_allclose(pixels[k, :5], right, atol=0.6)
        assert seen[k, :5].all()
    np.testing.assert_array_equal(pixels[[0, 1], [0, 3]], queries[:, 1:])


def test_a_point_that_is_covered_is_not_seen():
    _, seen = finish(following_pixels(sliding, FRAMES, np.array([[0, 90.0, 40.0]])))
    assert seen[0, :5].all()
    assert not seen[0, 5:].any()


def test_large_frames_are_matched_small_and_answered_in_their_own_pixels(monkeypatch):
    monkeypatch.setattr("degense.engine.motion.points.PIXELS", WIDTH * HEIGHT // 4)
    pixels, _ = finish(following_pixels(sliding, 4, np.array([[0, 30.0, 40.0]])))
    np.testing.assert_allclose(pixels[0, 3], (36, 43), atol=0.8)
