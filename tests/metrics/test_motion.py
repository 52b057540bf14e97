"""Motion scores against a loop over all pixels."""

import json

import numpy as np
import pytest

from degense.engine.metrics.motion import RELATIVE, MotionScores, scene_depth
from tests.fakes import MemoryClip

DEPTH = 80.0


def frames(seed, count=4, shape=(9, 11), offset=0.0):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        truth = (rng.normal(0, 1, (*shape, 3)) * (rng.random((*shape, 1)) < 0.6) + offset).astype(np.float32)
        predicted = np.abs(np.linalg.norm(truth, axis=-1) * rng.uniform(0.2, 1.3, shape) + rng.normal(0, 0.1, shape))
        truth[rng.random(shape) < 0.2] = np.nan
        predicted[rng.random(shape) < 0.1] = np.nan
        yield predicted, truth, rng.random(shape) < 0.15


def loop(data, still):
    p, t, burnt, tissue = [], [], [], 0
    for predicted, truth, cautery in data:
        for pixel in np.ndindex(predicted.shape):
            norm = float(np.sqrt(sum(float(v) ** 2 for v in truth[pixel])))
            tissue += np.isfinite(norm)
            if np.isfinite(norm) and np.isfinite(predicted[pixel]):
                p.append(predicted[pixel])
                t.append(norm)
                burnt.append(bool(cautery[pixel]))
    p, t, burnt = np.array(p), np.array(t), np.array(burnt)
    return {
        "displacement_error": np.abs(p - t).mean(),
        "displacement_correlation": np.corrcoef(p, t)[0, 1],
        "recovered_share": np.minimum(p, t).sum() / t.sum(),
        "spurious_displacement": np.maximum(p[burnt] - t[burnt], 0).mean(),
        "spurious_displacement_static": np.clip(p - t, 0, None)[burnt & (t <= still)].mean(),
        "false_motion": np.clip(p - t, 0, None)[~burnt & (t <= still)].mean(),
        "true_displacement": t.mean(),
        "largest_displacement": t.max(),
        "displacement_coverage": len(p) / tissue,
    }


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_score_matches_a_loop(seed):
    data = list(frames(seed))
    scores = MotionScores(DEPTH, static=0.3 / DEPTH)
    for frame in data:
        scores.add(*frame)
    result = scores.result()
    by_hand = loop(data, 0.3)
    marked = [name for name in result if name.endswith(("_revealed", "_uncertain"))] + ["sure_kept", "good_guesses"]
    assert {f"{name}_revealed" for name in by_hand} < set(marked)
    assert all(result.pop(name) is None for name in marked)  # nothing was marked
    assert result.pop("displacement_error_by_observability") == {}
    assert result.pop("displacement_scale") == DEPTH
    for name in RELATIVE:
        assert result.pop(f"{name}_relative") == pytest.approx(by_hand[name] / DEPTH, rel=1e-9)
    assert result == pytest.approx(by_hand, rel=1e-9)


def test_marked_pixels_are_scored_apart():
    marks = np.random.default_rng(8)
    scores, only, errors, marked, beyond = MotionScores(DEPTH), MotionScores(DEPTH), [], [], []
    for guess, truth, cautery in frames(9):
        uncertain = marks.random(cautery.shape) < 0.3
        scores.add(guess, truth, cautery, uncertain)
        only.add(np.where(uncertain, np.nan, guess), truth, cautery)
        difference = guess - np.linalg.norm(truth.astype(float), axis=-1)
        error = np.abs(difference)
        errors.append(error[np.isfinite(error)])
        marked.append(uncertain[np.isfinite(error)])
        beyond.append(np.maximum(difference, 0)[np.isfinite(error) & cautery & ~uncertain])
    error, mark = np.concatenate(errors), np.concatenate(marked)
    result = scores.result()
    assert result["displacement_error_revealed"] == pytest.approx(error[~mark].mean(), rel=1e-9)
    assert result["displacement_error_uncertain"] == pytest.approx(error[mark].mean(), rel=1e-9)
    assert result["displacement_error"] == pytest.approx(error.mean(), rel=1e-9)
    assert result["sure_kept"] == pytest.approx((error[~mark] <= 0.005 * DEPTH).mean())
    assert result["good_guesses"] == pytest.approx(mark[error <= 0.005 * DEPTH].mean())
    assert result["spurious_displacement_revealed"] == pytest.approx(np.concatenate(beyond).mean(), rel=1e-9)
    for name, value in only.result().items():  # as if nothing were displayed where it is a guess
        if f"{name}_revealed" in result:
            assert result[f"{name}_revealed"] == pytest.approx(value, rel=1e-9)


def test_errors_by_displayed_observability():
    truth = np.zeros((1, 6, 3), np.float32)
    truth[0, :, 0] = [1, 2, 3, 4, 5, np.nan]
    scores = MotionScores(DEPTH)
    guess = np.array([[1.5, 2.0, 0.0, 4.0, np.nan, 9.0]])
    scores.add(guess, truth, np.zeros((1, 6), bool), None, np.array([[0.1, 0.24, 0.25, 1.0, 0.9, 0.9]]))
    assert scores.result()["displacement_error_by_observability"] == {
        "0-0.25": {"error": 0.25, "true_displacement": 1.5, "share": 0.5},
        "0.25-0.5": {"error": 3.0, "true_displacement": 3.0, "share": 0.25},
        "0.5-0.75": {"error": None, "true_displacement": None, "share": 0.0},
        "0.75-1": {"error": 0.0, "true_displacement": 4.0, "share": 0.25},
    }


def test_the_unit_of_a_scene_changes_no_pixel_from_static_to_moving():
    data = list(frames(11))
    millimetres, decimetres = MotionScores(DEPTH, static=0.3 / DEPTH), MotionScores(DEPTH / 100, static=0.3 / DEPTH)
    for guess, truth, cautery in data:
        millimetres.add(guess, truth, cautery)
        decimetres.add(guess / 100, truth / 100, cautery)
    a, b = millimetres.result(), decimetres.result()
    for name in RELATIVE:
        assert a[f"{name}_relative"] == pytest.approx(b[f"{name}_relative"], rel=1e-6)
        assert a[name] == pytest.approx(100 * b[name], rel=1e-6)


def test_the_depth_of_a_scene_is_the_median_of_what_is_known():
    clip = MemoryClip(labels=False)
    assert scene_depth(clip) == 2.0
    clip.depth = lambda index: np.zeros(clip.size[::-1], np.float32)
    assert scene_depth(clip) is None


def test_pooling_keeps_its_digits_far_from_zero():
    data = list(frames(4, offset=1e5))
    scores = MotionScores(DEPTH)
    for frame in data:
        scores.add(*frame)
    pooled = np.concatenate([np.stack([p, np.linalg.norm(t.astype(float), axis=-1)], -1).reshape(-1, 2) for p, t, _ in data])
    pooled = pooled[np.isfinite(pooled).all(-1)]
    assert scores.result()["displacement_correlation"] == pytest.approx(np.corrcoef(pooled.T)[0, 1], abs=1e-9)


def test_vectors_and_norms_score_alike():
    _, truth, cautery = next(frames(5))
    vectors = np.random.default_rng(6).normal(size=truth.shape)
    a, b = MotionScores(DEPTH), MotionScores(DEPTH)
    a.add(vectors, truth, cautery)
    b.add(np.linalg.norm(vectors, axis=-1), truth, cautery)
    assert a.result() == b.result()


def test_trivial_answers():
    _, truth, cautery = next(frames(7))
    nothing, perfect = MotionScores(DEPTH), MotionScores(DEPTH)
    nothing.add(np.zeros(cautery.shape), truth, cautery)
    perfect.add(truth, truth, cautery)
    still = nothing.result()
    assert still["displacement_correlation"] is None
    assert still["recovered_share"] == 0
    assert still["spurious_displacement"] == still["false_motion"] == 0
    assert still["displacement_error"] == pytest.approx(still["true_displacement"])
    assert perfect.result()["displacement_error"] == 0
    assert perfect.result()["displacement_correlation"] == pytest.approx(1)
    assert perfect.result()["recovered_share"] == pytest.approx(1)


def test_degenerate_input_gives_none_and_json():
    shape = (4, 5)
    empty, unseen, constant = MotionScores(DEPTH), MotionScores(DEPTH), MotionScores(DEPTH)
    unseen.add(np.ones(shape), np.full((*shape, 3), np.nan), np.zeros(shape, bool))
    for value in (0.1, 0.1, 0.1):
        constant.add(np.random.default_rng(8).random(shape), np.full((*shape, 3), value), np.zeros(shape, bool))
    for scores in (empty, unseen):
        known = {name: value for name, value in scores.result().items() if value is not None}
        assert known == {"displacement_scale": DEPTH, "displacement_error_by_observability": {}}
    assert constant.result()["displacement_correlation"] is None
    assert constant.result()["spurious_displacement"] is None
    for scores in (empty, unseen, constant):
        json.dumps(scores.result(), allow_nan=False)
    with pytest.raises(ValueError, match="shapes differ"):
        empty.add(np.ones((3, 3)), np.ones((*shape, 3)), np.zeros(shape, bool))
