"""Baselines by hand on clips whose motion is known, and on a tiny phantom with a degraded teacher."""

import json

import numpy as np
import pytest

import degense.engine.research  # noqa: F401  adds the teacher "degraded"
from degense.engine.clip import UNLABELLED, Truth
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.metrics.motion import MotionScores, scene_depth
from degense.engine.metrics.tracks import depth_at
from degense.engine.research.baselines import ClipFlow, below_baseline, note, number, score_baselines
from degense.engine.research.baselines.clip_flow import warped_filled
from degense.engine.research.baselines.images import mean_colour
from degense.engine.research.baselines.masks import near, nearest, nothing_held_out, propagated, teacher_labels, vote, vote_along
from degense.engine.research.baselines.motion import lifted_displacement, lifted_tracks, motion_baselines
from degense.engine.research.degraded_teachers import DegradedTeacher
from degense.engine.semantics.teachers import teacher_by_name
from tests.fakes import MemoryClip, MovingWall

DEGRADED = "degraded:model=flips,strength=3"


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("baselines") / "clip"
    make_phantom(folder, PhantomOptions(frames=18, width=96, height=80, seed=2))
    return open_clip(folder)


@pytest.fixture(scope="module")
def flow(clip):
    return ClipFlow(clip)


@pytest.fixture(scope="module")
def scores(clip, flow):
    return score_baselines(clip, DEGRADED, flow=flow)


@pytest.fixture(scope="module")
def wall():
    """Moves 2 pixels to the right a frame, and towards the camera."""
    return MovingWall(6, velocity=(0.0625, 0.0, -0.02), labelled=range(6))


def test_votes_by_hand():
    maps = {0: [[0, 1, 1, 255]], 1: [[0, 0, 1, 255]], 3: [[1, 1, 255, 255]], 20: [[1, 0, 0, 255]]}
    known = {frame: np.array(labels, np.uint8) for frame, labels in maps.items()}
    assert vote(known, 2).tolist() == [[0, 0, 1, 255]]  # ties go to the first class
    assert vote(near(known, 9), 2).tolist() == [[0, 0, 1, 255]]  # frames 1 and 3
    assert list(near(known, 12)) == [20]
    assert list(near(known, 40)) == [20]
    assert nearest(2, [1, 3]) == 1


def test_labels_follow_chained_flow(wall):
    flow, inner = ClipFlow(wall), np.s_[8:-8, 16:-16]
    found = flow.chained(2, [0, 2, 5])
    assert set(found) == {0, 2, 5}
    for source, (way, sure) in found.items():
        assert np.quantile(np.abs(way - wall.flow(2, source))[inner], 0.95) < 1  # a frame is two pixels
        assert sure[inner].mean() > 0.95
    assert (propagated(flow, 5, 0, wall.labels(0)) == wall.labels(5))[inner].mean() > 0.98
    assert (propagated(flow, 1, 4, wall.labels(4)) == wall.labels(1))[inner].mean() > 0.98
    known = {i: wall.labels(i) for i in (0, 1, 4, 5)}
    along, still = (predicted == wall.labels(3) for predicted in (vote_along(flow, 3, known, 2), vote(known, 2)))
    assert along[inner].mean() > 0.98
    assert along[inner].mean() > still[inner].mean() + 0.005


def test_what_enters_the_picture_takes_the_nearest_label():
    way = np.zeros((3, 6, 2), np.float32)
    way[..., 0] = 2
    moved, inside = warped_filled(np.tile(np.array([0, 1, 2, 3, 4, 5], np.uint8), (3, 1)), way)
    assert moved.tolist() == [[2, 3, 4, 5, 5, 5]] * 3
    assert inside.tolist() == [[True] * 4 + [False] * 2] * 3


def test_flow_is_lifted_with_the_depth_of_both_ends(wall):
    flow = ClipFlow(wall)
    for frame in range(6):
        wrong = np.abs(lifted_displacement(wall, flow, frame) - frame * wall.velocity)[8:-8, 16:-16]
        assert np.quantile(wrong, 0.95) < 0.02  # less than a pixel, which is 0.031
    start = wall.cameras[0].unproject(np.array([[40.5, 30.5], [30.5, 50.5]]), np.array([3.0, 3.0]))
    tracks = (start[:, None] + np.arange(6)[:, None] * wall.velocity).astype(np.float32)
    truth = Truth(np.zeros((6, 72, 96, 3), np.float32), np.zeros((6, 72, 96), bool), tracks, np.ones((2, 6), bool))
    np.testing.assert_allclose(lifted_tracks(wall, flow, truth), tracks, atol=0.02)


def test_without_measured_depth_everything_is_as_far(wall):
    blind = MovingWall(6, velocity=(0.0625, 0.0, -0.02), measured=False)
    assert not depth_at(blind, 0, np.zeros((4, 2))).any()
    found = lifted_displacement(blind, ClipFlow(blind), 4)[8:-8, 16:-16]
    assert np.abs(found[..., 2]).max() == 0
    assert np.median(found[..., 0]) == pytest.approx(4 * 0.0625, abs=0.02)


def test_depth_of_the_nearest_pixel_inside():
    clip = MemoryClip()
    assert depth_at(clip, 0, np.array([[6.0, 12.0], [5.9, 12.0], [-0.1, 5.0], [48.0, 5.0], [np.nan, 5.0]])).tolist() == pytest.approx(
        [1.8, 2.0, 0, 0, 0]
    )


def test_nothing_moves_errs_by_the_true_displacement(clip, scores):
    truth = clip.truth()
    norms = np.linalg.norm(truth.displacement.astype(float), axis=-1)
    still = scores["nothing moves"]
    assert still["displacement_error"] == pytest.approx(norms[np.isfinite(norms)].mean())
    assert still["displacement_error"] == pytest.approx(still["true_displacement"])
    assert (still["recovered_share"], still["displacement_correlation"], still["false_motion"]) == (0, None, 0)
    perfect = MotionScores(scene_depth(clip))
    perfect.add(truth.displacement[5], truth.displacement[5], truth.cautery[5])
    assert set(still) == {*perfect.result(), "tracks"}


def test_flow_beats_nothing_moves(scores):
    lifted = scores["chained optical flow"]
    assert lifted["displacement_error"] < scores["nothing moves"]["displacement_error"]
    assert lifted["displacement_correlation"] > 0.5
    assert lifted["displacement_coverage"] == pytest.approx(1.0)
    assert lifted["displacement_error_revealed"] < lifted["displacement_error"]


def test_a_vote_beats_the_unreliable_teacher(scores, clip):
    reached = {name: number(found, "miou") for name, found in scores.items()}
    assert reached["majority vote"] > reached["teacher"] + 0.05
    assert reached["majority vote along flow"] > reached["teacher"] + 0.05
    for name in ("teacher", "majority vote, ±8 frames", "propagated mask", "propagated mask, exact", "teacher, held-out frame shown"):
        assert 0 < reached[name] < 1, name
    assert scores["majority vote"]["mask_frames"] == clip.test_frames == [1, 9, 17]
    json.dumps(scores, allow_nan=False)


def test_the_exact_teacher_is_not_shown_the_truth(clip, flow):
    found = score_baselines(clip, "labels", flow=flow)
    assert "teacher, held-out frame shown" not in found
    assert "propagated mask, exact" not in found
    assert number(found["teacher"], "miou") < 1
    assert set(score_baselines(clip, "none", flow=flow)) == {
        "constant colour",
        "nearest training frame",
        "nothing moves",
        "chained optical flow",
    }


def test_answers_are_decoded_to_the_nearest_class(clip):
    exact = teacher_by_name("labels", clip)
    labels = teacher_labels(exact, clip, [2])[2]
    assert np.array_equal(labels[clip.valid(2)], clip.labels(2)[clip.valid(2)])
    assert (labels[~clip.valid(2)] == UNLABELLED).all()
    shown = teacher_by_name(DEGRADED, nothing_held_out(clip))
    assert isinstance(shown, DegradedTeacher)
    assert shown.targets(9) is not None
    assert teacher_by_name(DEGRADED, clip).targets(9) is None
    assert clip.test_frames == [1, 9, 17]


def test_pictures(clip, scores):
    pixels = np.concatenate([clip.frame(i)[clip.valid(i)] for i in clip.train_frames])
    np.testing.assert_allclose(mean_colour(clip), pixels.astype(float).mean(0), atol=0.51)
    assert scores["nearest training frame"]["psnr_mask"] > scores["constant colour"]["psnr_mask"] > 5


def test_labels_of_held_out_frames_are_read_by_scores_only(clip, flow, monkeypatch):
    """Predictions are the same when the true labels of held-out frames change."""
    real = type(clip).labels
    before = teacher_labels(teacher_by_name(DEGRADED, clip), clip, clip.train_frames)
    monkeypatch.setattr(type(clip), "labels", lambda self, i: np.zeros_like(real(self, i)) if i in self.test_frames else real(self, i))
    after = teacher_labels(teacher_by_name(DEGRADED, clip), clip, clip.train_frames)
    assert all(np.array_equal(before[i], after[i]) for i in clip.train_frames)


def test_below_a_baseline():
    rows = {"a": {"miou": {"rnse": 0.5, "argmax": 0.6}}, "b": {"miou": {"rnse": 0.2}}, "c": {"miou": {"rnse": None}}, "d": {}}
    baselines = {"vote": {"miou": {"labels": 0.55}}, "teacher": {"miou": {"labels": 0.7}}, "colour": {"psnr_mask": 9.0}}
    below = below_baseline(rows, baselines, "miou")
    assert below == {"a": ["teacher"], "b": ["teacher", "vote"]}
    assert note(below, "mIoU") == "† mIoU below teacher (a); teacher and vote (b)."
    assert note({}, "mIoU") == ""
    errors = {"x": {"displacement_error": 0.4}, "y": {"displacement_error": 0.1}}
    still = {"nothing moves": {"displacement_error": 0.3}}
    assert below_baseline(errors, still, "displacement_error", larger_is_better=False) == {"x": ["nothing moves"]}


def test_no_motion_without_truth(wall):
    assert motion_baselines(wall, ClipFlow(wall)) == {}
