"""LLFF poses and `camera.json` against cameras written down by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from degense.engine.data.readers import ClipOptions, open_clip
from degense.engine.errors import ClipError
from tests.data.readers.makers import HEIGHT, WIDTH, write_endonerf, write_poses


def moving(rng, count=5):
    """Rotations (rows: right, down, forward axes in the world) and centres of cameras, some 50 away from the origin, looking at it."""
    rotations, centres = [], []
    for _ in range(count):
        rotations.append(Rotation.from_rotvec(rng.normal(0, 0.1, 3)).as_matrix())
        centres.append(np.array([0, 0, -50]) + rng.normal(0, 3, 3))
    return np.stack(rotations), np.stack(centres)


@pytest.mark.parametrize("axes", ["llff", "opencv"])
def test_moving_cameras_see_points_where_they_are(tmp_path, axes):
    rng = np.random.default_rng(11)
    write_endonerf(tmp_path, rng)
    rotations, centres = moving(rng)
    poses = np.zeros((5, 3, 4))
    for i in range(5):
        right, down, forward = rotations[i]
        columns = (down, right, -forward) if axes == "llff" else (right, down, forward)
        poses[i] = np.stack([*columns, centres[i]], axis=1)
    write_poses(tmp_path, 5, poses)
    clip = open_clip(tmp_path, ClipOptions(pose_axes=axes))
    points = rng.uniform(-10, 10, (20, 3))
    in_first = np.array([[(p - centres[0]) @ axis for axis in rotations[0]] for p in points])
    for i in range(5):
        pixels, depths = clip.cameras[i].project(in_first)
        for p, pixel, depth in zip(points, pixels, depths, strict=True):
            x, y, z = (float((p - centres[i]) @ axis) for axis in rotations[i])
            assert depth == pytest.approx(z)
            assert pixel == pytest.approx([80 * x / z + WIDTH / 2, 80 * y / z + HEIGHT / 2])
    np.testing.assert_allclose(clip.cameras[0].viewmat, np.eye(4), atol=1e-12)
    assert "the camera moves" in clip.provenance["poses"]
    assert "set pose_axes to change" in clip.provenance["poses"]


def test_the_two_readings_of_a_moving_camera_differ(tmp_path):
    rng = np.random.default_rng(12)
    write_endonerf(tmp_path, rng)
    rotations, centres = moving(rng)
    write_poses(tmp_path, 5, np.concatenate([rotations.transpose(0, 2, 1), centres[..., None]], axis=2))
    llff, opencv = (open_clip(tmp_path, ClipOptions(pose_axes=axes)).cameras[3].viewmat for axes in ("llff", "opencv"))
    assert np.abs(llff - opencv).max() > 0.01


def test_equal_rows_are_a_camera_at_rest_whatever_they_say(tmp_path):
    write_endonerf(tmp_path, np.random.default_rng(13))
    pose = np.concatenate([Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix(), [[1], [2], [3]]], axis=1)
    write_poses(tmp_path, 5, np.tile(pose, (5, 1, 1)))
    np.testing.assert_array_equal(open_clip(tmp_path).cameras[2].viewmat, np.eye(4))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (np.zeros((4, 17)), "4 rows, but there are 5 frames"),
        (np.zeros((5, 15)), r"must be \[frames, 17\]"),
        (np.full((5, 17), np.nan), "not finite"),
        (np.zeros((5, 17)), "no rotation"),
    ],
)
def test_wrong_pose_tables(tmp_path, rows, message):
    write_endonerf(tmp_path, np.random.default_rng(14))
    np.save(tmp_path / "poses_bounds.npy", rows)
    with pytest.raises(ClipError, match=message):
        open_clip(tmp_path)


def test_a_pose_table_for_other_pictures_is_refused_unless_the_focal_is_set(tmp_path):
    write_endonerf(tmp_path, np.random.default_rng(15))
    write_poses(tmp_path, 5, hwf=(HEIGHT, WIDTH * 2, 80.0))
    with pytest.raises(ClipError, match="set focal instead"):
        open_clip(tmp_path)
    assert open_clip(tmp_path, ClipOptions(focal=70)).cameras[0].fx == 70
