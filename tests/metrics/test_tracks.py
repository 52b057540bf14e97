"""Track scores by hand, and tracks of a tiny real run."""

import numpy as np
import pytest

from degense.engine.camera import Camera
from degense.engine.clip import Truth
from degense.engine.data.files.point_files import KnownPoints
from degense.engine.metrics.evaluate import evaluate
from degense.engine.metrics.tracks import scene_tracks, score_known_points, score_points, score_tracks, still_tracks
from degense.engine.scene.tracks import Tracks
from tests.metrics.test_evaluate import without

CAMERA = Camera(100, 80, 100.0, 100.0, 50.0, 40.0)  # at depth 10 a unit is 10 pixels


def three_points():
    """One stands still, one goes 0.05 a frame to the right (half a pixel), one is not seen at frame 0; four frames."""
    tracks = np.zeros((3, 4, 3))
    tracks[..., 2] = 10.0
    tracks[1, :, 0] = 1 + 0.05 * np.arange(4)
    visible = np.ones((3, 4), bool)
    visible[2, 0] = False
    return tracks, visible


def test_scores_by_hand():
    tracks, visible = three_points()
    scores = score_tracks(still_tracks(tracks), tracks, visible, [CAMERA] * 4)
    # Point 1 is off by 0.05, 0.1, 0.15: 0.5, 1.0, 1.5 pixels, of which one pixel is near enough.
    assert scores == {
        "points": 2,
        "coverage": 1.0,
        "error": pytest.approx(0.05),
        "error_median": pytest.approx(0.025),
        "error_pixels": pytest.approx(0.5),
        "error_pixels_median": pytest.approx(0.25),
        "within": pytest.approx(5 / 6),
        "survival": pytest.approx((1 + 2 / 3) / 2),
    }
    perfect = score_tracks(tracks, tracks, visible, [CAMERA] * 4)
    assert (perfect["error"], perfect["error_pixels"], perfect["within"], perfect["survival"]) == (0, 0, 1, 1)


def test_a_lost_point_does_not_come_back_and_hidden_frames_do_not_count():
    tracks, visible = three_points()
    predicted = tracks.copy()
    predicted[1, 1, 0] += 1  # ten pixels, once
    visible[0, 2] = False
    predicted[0, 2] += 9
    scores = score_tracks(predicted, tracks, visible, [CAMERA] * 4)
    assert scores["within"] == pytest.approx(4 / 5)
    assert scores["survival"] == pytest.approx((1 + 0) / 2)
    assert scores["error"] == pytest.approx(1 / 5)


def test_without_a_prediction_a_point_is_lost():
    tracks, visible = three_points()
    predicted = tracks.copy()
    predicted[1] = np.nan
    scores = score_tracks(predicted, tracks, visible, [CAMERA] * 4)
    assert (scores["coverage"], scores["error"], scores["within"], scores["survival"]) == (0.5, 0, 0.5, 0.5)
    nothing = score_tracks(predicted, tracks, np.zeros_like(visible), [CAMERA] * 4)
    assert set(nothing.values()) == {0, None}


def test_a_run_is_scored_by_its_gaussians_alone(scene, clip):
    truth = clip.truth()
    pixels = np.array([(20, 24), (40, 30), (32, 12)])
    depth = np.array([clip.depth(0)[y, x] for x, y in pixels], float)
    start = clip.cameras[0].unproject(pixels + 0.5, depth)
    tracks = np.repeat(start[:, None], len(clip), 1).astype(np.float32)
    visible = np.ones(tracks.shape[:2], bool)
    tracks[2] = -50.0  # outside the picture
    found = scene_tracks(scene, tracks, visible, clip.cameras[0])
    np.testing.assert_array_equal(found[:2, 0], tracks[:2, 0])
    assert np.isnan(found[2]).all()
    assert np.isfinite(found[:2]).all()
    scores = evaluate(scene, without(clip, truth=lambda self: Truth(truth.displacement, truth.cautery, tracks, visible)))
    still = score_tracks(still_tracks(tracks), tracks, visible, clip.cameras)
    assert scores["tracks"] == score_tracks(found, tracks, visible, clip.cameras)
    assert scores["tracks_nothing_moves"] == still
    assert still["error"] == 0


def test_points_are_scored_by_the_rules_of_the_field():
    labels = np.zeros((2, 4, 2))
    labels[0, 2], labels[1, 0] = np.nan, np.nan  # the second point is first known at frame 1
    hidden = np.zeros((2, 4), bool)
    hidden[0, 2] = True
    pixels = np.zeros((2, 4, 2))
    pixels[0, 1], pixels[0, 3], pixels[1, 2], pixels[1, 3] = (3, 0), (10, 0), (0, 40), (0, 100)
    visible = np.ones((2, 4), bool)
    visible[0, 1] = False
    scores = score_points(pixels, visible, labels, hidden)
    assert scores["pairs"] == 4
    assert [scores[f"delta_{limit}"] for limit in (4, 8, 16, 32, 64)] == [0.25, 0.25, 0.5, 0.5, 0.75]
    assert scores["delta"] == pytest.approx(0.45)
    # shown and near | over four labelled pairs, those shown and not near, and the hidden one that is shown
    assert scores["jaccard"] == pytest.approx(np.mean([0 / 8, 0 / 8, 1 / 7, 1 / 7, 2 / 6]))
    assert scores["occlusion_accuracy"] == pytest.approx(3 / 5)
    assert (scores["endpoint_error"], scores["endpoint_error_median"]) == (38.25, 25)
    assert score_points(pixels, visible, np.full_like(labels, np.nan), hidden) == {"pairs": 0}


class MetricScene:
    """A scene of a clip with measured depth, whose camera stands still."""

    def __init__(self, clip, unit="mm"):
        self.clip, self.unit, self.frames, self.clip_size, self.camera = clip, unit, 3, (100, 80), lambda frame: CAMERA


class Wall:
    """A wall at depth 10 that is not measured in its left column."""

    depth_measured, size = True, (100, 80)

    def depth(self, frame):
        depth = np.full((80, 100), 10.0, np.float32)
        depth[:, 0] = 0
        return depth


def test_points_of_a_metric_clip_are_scored_in_millimetres_too():
    pixels = np.full((2, 3, 2), np.nan)
    pixels[0], pixels[1, 0], pixels[1, 2] = (60.5, 40.5), (20.5, 20.5), (0.5, 20.5)
    known = KnownPoints(pixels, np.zeros((2, 3), bool))
    followed = np.nan_to_num(pixels)
    followed[0, 1:, 0] += [3, 30]
    positions = CAMERA.unproject(followed, np.full((2, 3), 10.0))
    found = Tracks(positions, followed, np.ones((2, 3), bool))
    scores = score_known_points(MetricScene(Wall()), found, known)
    assert scores["endpoint_error"] == pytest.approx(33 / 3)
    assert scores["endpoint_error_relative"] == pytest.approx(0.03)
    assert scores["endpoint_error_mm"] == pytest.approx((0.3 + 3) / 2)  # the last label has no depth
    assert scores["endpoint_error_mm_median"] == pytest.approx(1.65)
    assert scores["delta_4"] == pytest.approx(2 / 3)
    centimetres = score_known_points(MetricScene(Wall(), "cm"), found, known)
    assert centimetres["endpoint_error_mm"] == pytest.approx(16.5)
    for scene in (MetricScene(None), MetricScene(Wall(), "scene units")):
        assert "endpoint_error_mm" not in score_known_points(scene, found, known)


def test_ends_that_nobody_paired_are_scored_by_the_nearest():
    pixels = np.full((1, 3, 2), np.nan)
    pixels[0, 0] = 5, 5
    known = KnownPoints(pixels, np.zeros((1, 3), bool), np.array([[50.0, 5.0], [12.0, 5.0]]))
    followed = np.full((1, 3, 2), 7.0)
    followed[0, 2] = 10, 5
    scores = score_known_points(MetricScene(None), Tracks(np.zeros((1, 3, 3)), followed, np.ones((1, 3), bool)), known)
    assert (scores["pairs"], scores["endpoint_error"]) == (1, 2)
