"""Poses of phantoms against their truth; a still camera stays still; clips that show nothing say so."""

import numpy as np
import pytest

import degense.engine.data.poses.tracks as tracks
from degense.engine.data.poses import PoseEstimate, estimate_poses, find_cameras
from degense.engine.data.poses.tracks import Lost
from degense.engine.data.readers import open_clip
from degense.engine.research.benchmarks.cameras import pose_errors
from tests.fakes import MemoryClip


def test_rigid_tissue_gives_metric_poses(rigid, without_poses):
    clip = open_clip(without_poses(rigid))
    assert clip.poses == "auto"
    found = find_cameras(clip)
    assert found.poses == "given"
    assert "estimated: the camera moves up to" in found.provenance["poses"]
    place, turn = pose_errors(found.cameras, open_clip(rigid).cameras)  # mm, of a path of 9 mm and 3.5°; nothing is aligned
    assert place.mean() < 0.4
    assert place.max() < 0.8
    assert turn.max() < 0.4
    assert (clip.cameras[5].viewmat == np.eye(4)).all()  # the clip that was given is as it was


def test_breathing_is_all_that_is_taken_for_camera_motion(moving, without_poses):
    found = find_cameras(open_clip(without_poses(moving)))
    place, turn = pose_errors(found.cameras, open_clip(moving).cameras)
    assert place.mean() < 0.9  # mm: the tissue rises by 1.3 on average
    assert place.max() < 1.8
    assert turn.max() < 0.4


def test_held_out_frames_are_never_read_and_have_poses(rigid, without_poses, monkeypatch):
    clip = open_clip(without_poses(rigid))
    read = []
    monkeypatch.setattr(clip.pictures, "read", lambda i, real=clip.pictures.read: (read.append(i), real(i))[1])
    place, _ = pose_errors(find_cameras(clip).cameras, open_clip(rigid).cameras)
    assert set(read) == set(clip.train_frames)
    assert place[clip.test_frames].max() < 0.9


def test_without_depth_the_path_is_right_up_to_its_scale(rigid, without_poses):
    clip = open_clip(without_poses(rigid, depth=False))
    assert not clip.depth_measured
    found = find_cameras(clip)
    assert "lengths follow the depth prior" in found.provenance["poses"]
    ours, true = (np.stack([-c.viewmat[:3, :3].T @ c.viewmat[:3, 3] for c in x.cameras]).ravel() for x in (found, open_clip(rigid)))
    assert np.corrcoef(ours, true)[0, 1] > 0.99


def test_a_still_camera_stays_still(still, without_poses):
    clip = open_clip(without_poses(still))
    found = find_cameras(clip)
    assert all((camera.viewmat == np.eye(4)).all() for camera in found.cameras)
    assert found.provenance["poses"].startswith("assumed: the camera stands still; ")
    assert "never leaves its place" in found.provenance["poses"]
    clip.poses = "estimate"
    forced = find_cameras(clip)
    assert "it may stand still" in forced.provenance["poses"]
    assert not (forced.cameras[5].viewmat == np.eye(4)).all()


def test_it_is_deterministic(moving, without_poses):
    folder = without_poses(moving)
    first, second = (estimate_poses(open_clip(folder)).viewmats for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_many_key_frames_drift_less_when_loops_are_closed(rigid, without_poses, monkeypatch):
    clip, true = open_clip(without_poses(rigid)), open_clip(rigid).cameras
    monkeypatch.setattr(tracks, "LEFT", 0.93)
    closed, _ = pose_errors(find_cameras(clip).cameras, true)
    monkeypatch.setattr("degense.engine.data.poses.estimate.close_loops", lambda keys, viewmats, progress: [])
    drifted, _ = pose_errors(find_cameras(clip).cameras, true)
    assert closed.mean() < 0.4
    assert closed.mean() < drifted.mean()


def test_black_frames_between_are_bridged(rigid, without_poses, monkeypatch):
    clip = open_clip(without_poses(rigid))
    dark = (6, 7)
    monkeypatch.setattr(clip, "frame", lambda i, real=clip.frame: real(i) * (i not in dark))
    place, turn = pose_errors(find_cameras(clip).cameras, open_clip(rigid).cameras)
    assert place.max() < 1.2
    assert turn.max() < 0.5


@pytest.mark.parametrize("poses", ["auto", "estimate"])
@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("one frame", "a single frame shows no motion"),
        ("black", "no tissue with texture"),
        ("all masked", "no tissue with texture"),
        ("black from frame 3 on", "cannot be followed beyond frame 2"),
    ],
)
def test_clips_that_show_nothing_stay_still_and_say_why(rigid, without_poses, monkeypatch, change, reason, poses):
    clip = open_clip(without_poses(rigid))
    if change == "one frame":
        clip.cameras = clip.cameras[:1]
    elif change == "all masked":
        monkeypatch.setattr(clip, "valid", lambda i: np.zeros(clip.size[::-1], bool))
    else:
        start = 0 if change == "black" else 3
        monkeypatch.setattr(clip, "frame", lambda i, real=clip.frame: real(i) * (i < start))
    clip.poses = poses
    found = find_cameras(clip)
    assert found.provenance["poses"].startswith("assumed: the camera stands still; ")
    assert reason in found.provenance["poses"]
    assert all((camera.viewmat == np.eye(4)).all() for camera in found.cameras)


def test_tiny_pictures():
    with pytest.raises(Lost, match="too small"):
        estimate_poses(MemoryClip(width=20, height=20))


@pytest.mark.parametrize(
    ("explained", "static_area", "doubt"),
    [(0.9, 0.0, ""), (0.0, 0.0, "hardly anything moves"), (0.9, 0.2, "20 % of the tissue"), (0.5, 0.0, "only 50 %")],
)
def test_when_a_camera_is_said_to_move(explained, static_area, doubt):
    found = PoseEstimate(np.eye(4)[None], 1.0, 1.0, explained, static_area)
    assert doubt in found.doubt
    assert bool(found.doubt) is bool(doubt)
