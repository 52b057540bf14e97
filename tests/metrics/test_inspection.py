"""The warp layer as a detector of wrong motion, against the definition, and true motion against a turned camera."""

from dataclasses import replace

import numpy as np
import pytest

from degense.engine.camera import Camera
from degense.engine.metrics.inspection import InspectionScores, pooled_average_precision, true_motion
from tests.fakes import MemoryClip


def average_precision(values: np.ndarray, wrong: np.ndarray) -> float:
    """Σ (Rₙ − Rₙ₋₁) Pₙ over the distinct values from the largest down."""
    total, before = 0.0, 0.0
    for value in sorted(set(values.tolist()), reverse=True):
        taken = values >= value
        recall = (wrong & taken).sum() / wrong.sum()
        total += (recall - before) * wrong[taken].mean()
        before = recall
    return total


@pytest.mark.parametrize("seed", [0, 1])
def test_average_precision_is_that_of_the_definition(seed):
    rng, scores = np.random.default_rng(seed), InspectionScores()
    ranks, wrongs = [], []
    for _ in range(3):
        warp = np.where(rng.random((9, 11)) < 0.3, 0, rng.integers(0, 40, (9, 11)) / 8).astype(np.float32)
        warp[rng.random((9, 11)) < 0.2] = np.nan
        modelled, true = rng.normal(0, 1, (2, 9, 11, 2))
        true[rng.random((9, 11)) < 0.1] = np.nan
        scores.add(warp, modelled, true)
        off = np.linalg.norm(modelled - true, axis=-1)
        ranks.append(np.where(np.isfinite(warp), warp, -1)[np.isfinite(off)])
        wrongs.append(off[np.isfinite(off)] > 1)
    values, wrong, found = np.concatenate(ranks), np.concatenate(wrongs), scores.result()
    assert found["average_precision"] == pytest.approx(average_precision(values, wrong))
    assert found["wrong"] == pytest.approx(wrong.mean())
    assert found["precision"] == pytest.approx(wrong[values > 1].mean())
    assert found["recall"] == pytest.approx((values > 1)[wrong].mean())
    assert found["unknown"] == pytest.approx((values < 0).mean())


def test_a_perfect_layer_a_blind_one_and_nothing():
    off = np.zeros((4, 5, 2))
    off[1:3, 2, 0] = 6
    for warp, expected in ((off[..., 0] - 1, 1.0), (np.full((4, 5), np.nan), 0.1)):
        scores = InspectionScores()
        scores.add(warp, off, np.zeros((4, 5, 2)))
        assert scores.result()["average_precision"] == pytest.approx(expected)
    nothing = InspectionScores().result()
    assert {name: value for name, value in nothing.items() if name != "ranked"} == dict.fromkeys(
        ("average_precision", "wrong", "precision", "recall", "unknown")
    )
    assert pooled_average_precision([nothing]) is None


def test_pixels_of_many_runs_are_ranked_together():
    """A scene in which little is wrong counts as much as it has wrong pixels; coarse ranks hardly lose."""
    rng, found, ranks, wrongs = np.random.default_rng(0), [], [], []
    for share in (0.02, 0.4):
        scores = InspectionScores()
        off = np.where(rng.random((60, 50)) < share, 3.0, 0.0)
        warp = np.abs(off + rng.normal(0, 1.5, off.shape)).astype(np.float32)
        warp[rng.random(off.shape) < 0.1] = np.nan
        warp[0] = 0
        scores.add(warp, np.dstack([off, 0 * off]), np.zeros((60, 50, 2)))
        found.append(scores.result())
        ranks.append(np.where(np.isfinite(warp), warp, -1).ravel())
        wrongs.append((off > 1).ravel())
    values, wrong = np.concatenate(ranks), np.concatenate(wrongs)
    pooled = pooled_average_precision(found)
    assert pooled == pytest.approx(average_precision(values, wrong), abs=0.01)
    for one, of_one in zip(found, wrongs, strict=True):
        assert sum(one["ranked"]["wrong"]) == of_one.sum()
        assert sum(one["ranked"]["right"]) == (~of_one).sum()
    assert abs(pooled - np.mean([one["average_precision"] for one in found])) > 0.05


def test_true_motion_leads_back_to_the_pixel_of_frame_0():
    """A wall at depth 20 that has moved by (1, −2, 0), seen by a camera that has gone 3 to the right since."""
    clip = MemoryClip(2, 32, 24)
    first = Camera(32, 24, 40.0, 40.0, 16.0, 12.0)
    view = first.viewmat.copy()
    view[0, 3] = -3.0
    clip.cameras = [first, replace(first, viewmat=view)]
    clip.depth = lambda index: np.where(np.arange(32) < 30, np.float32(20), np.float32(0)) * np.ones((24, 1), np.float32)
    moved = true_motion(clip, np.broadcast_to(np.array([1.0, -2.0, 0.0]), (24, 32, 3)), 1)
    assert moved[:, :30] == pytest.approx(np.broadcast_to([(3 - 1) * 40 / 20, 2 * 40 / 20], (24, 30, 2)))
    assert np.isnan(moved[:, 30:]).all()
