"""Thresholds and reliability against a loop over thresholds, and intervals against a printed table of Student's t."""

import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.metrics.calibration import STEPS, Calibration, ConfidenceCalibration
from degense.engine.metrics.masks import MaskScores
from degense.engine.research.report.method_scores import t_interval


def random_frames(seed, count=3):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        truth = rng.integers(0, 2, (8, 9)).astype(np.uint8)
        truth[rng.random((8, 9)) < 0.1] = 255
        yield (
            np.clip(rng.normal(0.3, 0.3, (3, 8, 9)) + 0.4 * (truth == np.arange(3)[:, None, None]), -0.5, 1.2),
            truth,
            rng.random((8, 9)) < 0.9,
        )


def test_every_threshold_is_what_masks_score_at_it():
    frames, calibration = list(random_frames(1)), Calibration("abc")
    for similarity, truth, valid in frames:
        for index in range(3):
            calibration.add(index, similarity[index], truth, valid)
    result = calibration.result(0.5)
    by_loop = {}
    for step in range(STEPS):
        scores = MaskScores("abc")
        for similarity, truth, valid in frames:
            for index in range(3):
                scores.add_mask(index, similarity[index] > step / STEPS, truth, valid)
        by_loop[step / STEPS] = scores.result()["miou"]
    assert result["miou_default"] == pytest.approx(by_loop[0.5])
    assert result["miou_best"] == pytest.approx(max(by_loop.values()))
    assert by_loop[result["best"]] == pytest.approx(result["miou_best"])
    assert [m for _, m in result["curve"]] == pytest.approx([by_loop[t] for t, _ in result["curve"]])


def test_a_class_that_is_absent_counts_only_where_it_is_claimed():
    calibration = Calibration(("a", "b"))
    truth = np.zeros((2, 2), np.uint8)
    calibration.add(0, np.full((2, 2), 0.7), truth)
    calibration.add(1, np.full((2, 2), 0.3), truth)
    assert calibration.curve(0)[69] == 1.0
    assert calibration.curve(0)[70] == 0.0
    assert calibration.curve(1)[29] == 0.0
    assert np.isnan(calibration.curve(1)[30]), "neither there nor claimed"
    result = calibration.result(0.2)
    assert (result["miou_default"], result["miou_best"]) == (0.5, 1.0)
    assert result["best"] == 0.3


def test_reliability_by_hand():
    calibration = Calibration(("a", "background"), skipped=("background",))
    truth = np.uint8([[0, 0, 1, 1, 1, 255]])
    calibration.add(0, np.array([[0.95, 0.92, 0.91, 0.05, -0.3, 0.9]]), truth)
    low, high = calibration.result(0.5)["reliability"]
    assert (low["pairs"], low["share"], low["similarity"]) == (2, 0.0, pytest.approx(0.025))
    assert (high["pairs"], high["share"], high["similarity"]) == (3, pytest.approx(2 / 3), pytest.approx(2.78 / 3))
    assert calibration.result(0.5)["error"] == pytest.approx((2 * 0.025 + 3 * (2.78 - 2) / 3) / 5)
    assert Calibration(("background",), skipped=("background",)).result(0.5)["best"] is None


def test_intervals_match_the_printed_table():
    """Student's t, two-sided 95 %: 12.706 for one degree of freedom, 4.303 for two."""
    mean, half = t_interval([0.8, 0.9])
    assert (mean, half) == (pytest.approx(0.85), pytest.approx(12.706 * 0.05, rel=1e-4))
    mean, half = t_interval([1.0, 2.0, 3.0])
    assert (mean, half) == (pytest.approx(2.0), pytest.approx(4.303 / 3**0.5, rel=1e-3))
    assert t_interval([0.5]) == (0.5, None)


def test_confidence_against_the_share_of_the_mask_that_is_right():
    truth = np.array([[0, 0, 1, 1, UNLABELLED]], np.uint8)
    valid = np.array([[True, True, True, False, True]])
    confidence = ConfidenceCalibration()
    everywhere = np.full((1, 5), 0.9)
    confidence.add(everywhere, np.array([[True, True, True, True, True]]), 0, truth, valid)  # two of three that count
    confidence.add(everywhere - 0.35, np.array([[False, False, True, False, False]]), 1, truth, valid)  # all
    confidence.add(everywhere, np.zeros((1, 5), bool), 1, truth, valid)  # shows nothing
    result = confidence.result()
    assert result["masks"] == 2
    assert result["confidence"] == pytest.approx((0.9 + 0.55) / 2)
    assert result["precision"] == pytest.approx(5 / 6)
    assert result["error"] == pytest.approx((0.9 - 2 / 3 + 0.45) / 2)
    assert result["excess"] == pytest.approx(0.725 - 5 / 6)
    low, high = result["pixels"]["reliability"]
    assert (low["number"], low["said"], low["right"]) == (1, pytest.approx(0.55), 1.0)
    assert (high["number"], high["said"], high["right"]) == (3, pytest.approx(0.9), pytest.approx(2 / 3))
    assert result["pixels"]["error"] == pytest.approx((3 * (0.9 - 2 / 3) + 0.45) / 4)
    assert result["objects"]["error"] == pytest.approx((0.9 - 2 / 3 + 0.45) / 2), "of two objects, whatever their size"
    assert ConfidenceCalibration().result()["error"] is None


def test_objects_are_the_connected_parts_of_a_mask():
    truth = np.array([[0, 0, 1, 1, 0]], np.uint8)
    confidence = ConfidenceCalibration()
    confidence.add(np.array([[0.95, 0.97, 0.5, 0.25, 0.25]]), np.array([[True, True, False, True, True]]), 0, truth, np.ones((1, 5), bool))
    bins = confidence.result()["objects"]["reliability"]
    assert [(entry["number"], entry["said"], entry["right"]) for entry in bins] == [
        (1, pytest.approx(0.25), 0.5),
        (1, pytest.approx(0.96), 1),
    ]
