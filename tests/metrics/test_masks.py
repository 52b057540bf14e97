"""Mask scores against brute force."""

import numpy as np
import pytest

from degense.engine.metrics.masks import MaskScores, boundary_f, iou


def sets(mask):
    return {tuple(p) for p in np.argwhere(mask)}


def test_iou_matches_sets():
    rng = np.random.default_rng(1)
    for _ in range(20):
        a, b = rng.random((7, 9)) < rng.random(), rng.random((7, 9)) < rng.random()
        union = sets(a) | sets(b)
        assert iou(a, b) == (pytest.approx(len(sets(a) & sets(b)) / len(union)) if union else None)
    nothing, something = np.zeros((4, 4), bool), np.eye(4, dtype=bool)
    assert iou(nothing, nothing) is None
    assert iou(something, nothing) == iou(nothing, something) == 0


def brute_boundary(mask):
    height, width = mask.shape
    found = []
    for y, x in np.argwhere(mask):
        beside = [(y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)]
        if any(0 <= j < height and 0 <= i < width and not mask[j, i] for j, i in beside):
            found.append((y, x))
    return np.array(found, float).reshape(-1, 2)


def test_boundary_f_matches_all_pairs():
    rng = np.random.default_rng(2)
    y, x = np.indices((40, 50))
    for _ in range(8):
        a, b = (np.hypot(y - rng.uniform(10, 30), x - rng.uniform(10, 40)) < rng.uniform(5, 15) for _ in range(2))
        p, t = brute_boundary(a), brute_boundary(b)
        distance = np.linalg.norm(p[:, None] - t[None], axis=-1)
        precision, recall = (distance.min(1) <= 3.0).mean(), (distance.min(0) <= 3.0).mean()
        expected = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
        assert boundary_f(a, b, 3.0) == pytest.approx(expected)
    assert boundary_f(a, a) == 1.0
    assert boundary_f(a, np.zeros_like(a)) == 0.0
    assert boundary_f(np.zeros_like(a), np.ones_like(a)) is None, "a mask of the whole picture has no outline"


def brute_scores(frames, classes):
    per_class, pairs = {c: [] for c in range(classes)}, []
    for predicted, truth, valid in frames:
        pixels = [p for p in np.ndindex(truth.shape) if truth[p] != 255 and valid[p]]
        for c in range(classes):
            guess, right = {p for p in pixels if predicted[p] == c}, {p for p in pixels if truth[p] == c}
            if guess | right:
                per_class[c].append(len(guess & right) / len(guess | right))
            if right:
                pairs.append(len(guess & right) / len(right | guess))
    means = [np.mean(v) for v in per_class.values() if v]
    return np.mean(means), np.mean(pairs), per_class


def test_miou_matches_brute_force():
    rng = np.random.default_rng(3)
    scores, frames = MaskScores("abcde"), []
    for k in range(4):
        truth = rng.integers(0, 3 if k % 2 else 4, (6, 8)).astype(np.uint8)
        predicted = np.where(rng.random((6, 8)) < 0.6, truth, rng.integers(0, 5 if k == 1 else 4, (6, 8))).astype(np.uint8)
        truth[rng.random((6, 8)) < 0.1] = 255
        predicted[rng.random((6, 8)) < 0.1] = 255
        frames.append((predicted, truth, rng.random((6, 8)) < 0.9))
        scores.add(*frames[-1])
    miou, pairs, per_class = brute_scores(frames, 5)
    result = scores.result()
    assert result["miou"] == pytest.approx(miou)
    assert result["miou_pairs"] == pytest.approx(pairs)
    for c, name in enumerate("abcde"):
        assert result["iou"][name] == (pytest.approx(np.mean(per_class[c])) if per_class[c] else None)
    assert result["miou"] < result["miou_pairs"], "false positives on absent classes cost here, and are free with the peers"


def test_absent_classes():
    truth = np.zeros((5, 5), np.uint8)
    scores = MaskScores(("a", "b", "c"))
    scores.add(truth, truth)
    assert scores.result()["miou"] == 1.0
    assert scores.result()["iou"] == {"a": 1.0, "b": None, "c": None}
    wrong = truth.copy()
    wrong[0, 0] = 1
    scores.add(wrong, truth)
    assert scores.result()["iou"]["b"] == 0.0
    assert scores.result()["miou"] == pytest.approx((1 + 24 / 25) / 2 / 2)
    assert scores.result()["floor"] == {"a": 1.0, "b": None, "c": None}


def test_false_positives_are_counted_apart_and_the_floor_is_scored_as_any_answer():
    """Three frames of 4 pixels: a fills two of them and half of the third, whose other half is b; c is nowhere."""
    truths = [np.uint8([[0, 0], [0, 0]]), np.uint8([[0, 0], [0, 0]]), np.uint8([[0, 0], [1, 1]])]
    guesses = [np.uint8([[0, 0], [0, 1]]), np.uint8([[0, 0], [0, 0]]), np.uint8([[0, 0], [1, 2]])]
    scores = MaskScores(("a", "b", "c"))
    for guess, truth in zip(guesses, truths, strict=True):
        scores.add(guess, truth)
    result = scores.result()
    assert result["iou_frames"] == {"a": [0.75, 1.0, 1.0], "b": [0.0, None, 0.5], "c": [None, None, 0.0]}
    assert result["false_positives"]["a"] == {"frames": 0, "absent": 0, "share": None}
    assert result["false_positives"]["b"] == {"frames": 1, "absent": 2, "share": 0.125}
    assert result["false_positives"]["c"] == {"frames": 1, "absent": 3, "share": pytest.approx(0.25 / 3)}
    assert result["miou"] == pytest.approx((2.75 / 3 + 0.25 + 0.0) / 3)
    assert result["miou_present"] == pytest.approx((2.75 / 3 + 0.5) / 2)
    assert result["miou_pairs"] == pytest.approx((0.75 + 1 + 1 + 0.5) / 4)
    everywhere = MaskScores(("a", "b", "c"))
    for truth in truths:
        everywhere.add(np.zeros_like(truth), truth)
    said = everywhere.result()
    assert result["floor_answer"] == {"class": "a", "miou": said["miou"], "miou_pairs": said["miou_pairs"]}
    assert said["miou"] == pytest.approx((2.5 / 3 + 0.0) / 2)
    assert said["miou_pairs"] == pytest.approx(2.5 / 4)


def test_overlapping_masks_skipped_classes_and_nothing():
    truth = np.repeat(np.uint8([[0, 1, 2, 255]]), 4, axis=0)
    scores = MaskScores(("background", "b", "c"), skipped=("background",))
    scores.add_mask(1, np.ones((4, 4), bool), truth)
    scores.add_mask(2, truth == 2, truth)
    result = scores.result()
    assert result["iou"] == {"b": pytest.approx(1 / 3), "c": 1.0}
    assert result["floor"]["b"] == pytest.approx(1 / 3)
    empty = MaskScores(("a",)).result()
    assert empty["miou"] is None
    assert empty["miou_pairs"] is None
    assert empty["boundary_f"] is None
    assert empty["floor_answer"] == {"class": None, "miou": None, "miou_pairs": None}
    unlabelled = MaskScores(("a",))
    unlabelled.add(np.zeros((3, 3), np.uint8), np.full((3, 3), 255, np.uint8))
    assert unlabelled.result()["miou"] is None
