"""Points followed through frames by small windows, on a texture whose motion is known."""

import cv2
import numpy as np

from degense.engine.motion.found_again import ORIGINS, Queries
from degense.engine.motion.matched import EVERY, _Chain, _turn, matching
from degense.engine.motion.matched_frame import FrameRing, MatchedFrame
from degense.engine.progress import finish
from tests.motion.test_points import FRAMES, sliding


def followed(queries):
    still = np.repeat(queries[:, None, 1:], FRAMES, axis=1)
    return finish(matching(sliding, still, queries))


def test_points_are_where_they_slide_to_both_ways():
    queries = np.array([[0, 40.0, 45.0], [3, 40.0, 50.0]])
    found = followed(queries)
    for k, (start, x, y) in enumerate(queries):
        right = np.array([[x + 2 * (t - start), y + (t - start)] for t in range(5)])
        np.testing.assert_allclose(found.pixels[k, :5], right, atol=0.3)
        assert (found.unlike[k, :5] < 4).all()
        far = np.abs(np.arange(5) - start) >= 2
        assert (found.guessed_unlike[k, :5][far] > 2 * found.unlike[k, :5][far]).all(), "it does not stay where it was"
        assert found.unlike[k, int(start)] == 0
        np.testing.assert_allclose(found.guessed_unlike[k, int(start)], 0, atol=1e-3)


def test_a_point_that_is_covered_is_lost_for_good():
    found = followed(np.array([[0, 90.0, 40.0]]))
    assert np.isfinite(found.unlike[0, :5]).all()
    assert np.isnan(found.pixels[0, 5:]).all()
    assert np.isnan(found.unlike[0, 5:]).all()
    assert np.isfinite(found.guessed_unlike[0]).all()


def test_where_nothing_is_guessed_nothing_is_said_of_the_guess():
    queries = np.array([[3, 40.0, 50.0]])
    found = finish(matching(sliding, np.full((1, FRAMES, 2), np.nan), queries))
    assert np.isnan(found.guessed_unlike).all()
    assert np.isfinite(found.pixels[0, :5]).all()


def test_no_points_are_no_work():
    assert followed(np.zeros((0, 3))).pixels.shape == (0, FRAMES, 2)


LONG, AWAY, BACK, ASIDE = 24, 5, 12, np.array([46, 21])


def returning(frame: int) -> np.ndarray:
    """A textured patch on another texture, uint8 [H, W, 3]: it leaves the view in frame `AWAY` and is back, elsewhere, in frame `BACK`."""
    rng = np.random.default_rng(7)
    ground, patch = (
        cv2.normalize(cv2.GaussianBlur(rng.random((*size, 3)).astype(np.float32), (0, 0), 2.0), None, 20, 230, cv2.NORM_MINMAX)
        for size in ((120, 170), (60, 60))
    )
    if not AWAY <= frame < BACK:
        x, y = (20, 25) + ASIDE * (frame >= BACK) + (frame, 0)
        ground[y : y + 60, x : x + 60] = patch
    return ground.astype(np.uint8)


PATCH = np.array([[0, 50.0, 55.0], [0, 43.5, 62.0]])


def test_what_leaves_and_returns_elsewhere_is_found_again():
    found = finish(matching(returning, np.full((2, LONG, 2), np.nan), PATCH))
    again = next(frame for frame in range(BACK, LONG) if np.isfinite(found.unlike[0, frame]))
    assert np.isnan(found.unlike[:, AWAY:BACK]).all(), "nothing else is taken for it"
    assert again < BACK + EVERY
    for frame in (*range(AWAY), *range(again, LONG)):
        right = PATCH[:, 1:] + (frame, 0) + ASIDE * (frame >= BACK)
        np.testing.assert_allclose(found.pixels[:, frame], right, atol=0.5)
        assert (found.unlike[:, frame] < 5).all()


def test_what_was_followed_to_something_else_is_taken_back():
    size = 170, 120
    ring = FrameRing(MatchedFrame(returning(0), size), 2)
    first, second = (MatchedFrame(returning(frame), size, ring.planes(frame)) for frame in range(2))
    queries = Queries(PATCH[:, 1:], np.zeros(2, int), lambda frame: MatchedFrame(returning(frame), size))
    chain = _Chain(queries, ring)
    chain.advance(np.array([0]))
    chain.begin(0, first)
    chain.advance(np.array([1]))
    there = chain.places.copy()
    astray = there[:1] + 30
    chain.places[:1], chain.unlike[:1] = astray, queries.unlike(np.arange(1), second, astray)
    chain.go_on_from(queries.found_in(second, 0))
    np.testing.assert_allclose(chain.places, there, atol=0.1)
    assert (chain.unlike < 5).all()


def test_plain_tissue_is_not_found_again():
    """A smooth shade between textures: it looks alike all around."""

    def shaded(frame: int) -> np.ndarray:
        picture = returning(0)
        picture[25:85, 20:80] = np.linspace(100, 104, 60).astype(np.uint8)[:, None]
        return picture if not AWAY <= frame < BACK else np.zeros_like(picture)

    found = finish(matching(shaded, np.full((1, LONG, 2), np.nan), PATCH[:1]))
    assert np.isnan(found.unlike[0, AWAY:]).all()


def test_points_of_many_frames_are_looked_for_in_turn():
    starts = np.array([0, 3, 3, 5, 7, 9, 30, 31, 40, 50, 60])
    assert _turn(starts, EVERY + 1) == []
    assert _turn(np.zeros(0, int), EVERY) == []
    assert _turn(starts[:4], EVERY) == [0, 3, 5]
    turns = [_turn(starts, EVERY * number) for number in range(1, 4)]
    assert all(len(turn) <= ORIGINS for turn in turns)
    assert sorted(frame for turn in turns for frame in turn) == sorted(set(starts))


def test_a_point_goes_the_same_way_alone_and_beside_others_that_begin_elsewhere():
    """Frames are taken together where no point begins."""
    queries = np.array([[0, 40.0, 45.0], [3, 40.0, 50.0], [4, 52.0, 44.0]])
    together = followed(queries)
    for k in range(len(queries)):
        for values, alone in zip(together, followed(queries[k : k + 1]), strict=True):
            np.testing.assert_array_equal(values[k], alone[0])


def test_planes_that_are_used_again_are_those_of_a_new_frame():
    """Nothing of the frame before is left in them, at the edges neither."""
    size = 85, 60
    ring = FrameRing(MatchedFrame(returning(0), size), 3)
    for number in range(5):
        used, new = MatchedFrame(returning(4 * number), size, ring.planes(number)), MatchedFrame(returning(4 * number), size)
        for kind in ("values", "dx", "dy"):
            for a, b in zip(getattr(used.pyramid, kind), getattr(new.pyramid, kind), strict=True):
                np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(used.grey, new.grey)
        np.testing.assert_array_equal(used.colours, new.colours)
    block = ring.block([2, 3, 4])
    np.testing.assert_array_equal(block.grey[block.numbers[-1]], new.grey)
    np.testing.assert_array_equal(block.values[0][block.numbers[-1]], new.pyramid.values[0][0])


def test_it_does_not_matter_how_many_threads_make_frames_ready(monkeypatch):
    queries = np.array([[0, 43.5, 62.0], *([frame, 30.0 + 4 * frame, 50.0] for frame in range(0, LONG, 3))])
    still = np.repeat(queries[:, None, 1:], LONG, axis=1)
    found = []
    for threads in (1, 2, 4):
        monkeypatch.setattr("degense.engine.motion.matched.kernel_threads", lambda threads=threads: threads)
        found.append(finish(matching(returning, still, queries)))
    for other in found[1:]:
        for values, expected in zip(other, found[0], strict=True):
            np.testing.assert_array_equal(values, expected)
