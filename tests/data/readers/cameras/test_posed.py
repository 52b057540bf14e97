"""Clips whose cameras Nerfstudio or COLMAP has found, written here by the letter of their formats."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from degense.engine.data.readers import detect, open_clip
from degense.engine.errors import ClipError
from tests.data.readers.makers import HEIGHT, WIDTH, write_frames

FX, FY, CX, CY = 80.0, 82.0, 47.0, 33.0
COUNT = 5


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.fixture
def poses(rng) -> np.ndarray:
    """World-to-camera matrices [5, 4, 4] of cameras some 30 before the origin."""
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    for matrix in matrices:
        matrix[:3, :3] = Rotation.from_rotvec(rng.normal(0, 0.1, 3)).as_matrix()
        matrix[:3, 3] = [*rng.normal(0, 2, 2), 30 + rng.normal()]
    return matrices


@pytest.fixture
def points(rng) -> np.ndarray:
    return rng.uniform(-5, 5, (40, 3))


def write_nerfstudio(folder: Path, rng, poses: np.ndarray, name: str = "images/{:06d}.png", **values: object) -> None:
    write_frames(folder / "images", rng, COUNT)
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    frames = [{"file_path": name.format(i), "transform_matrix": (np.linalg.inv(pose) @ flip).tolist()} for i, pose in enumerate(poses)]
    lens = {"fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY, "w": WIDTH, "h": HEIGHT}
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames[::-1], **values}))


def write_colmap(folder: Path, rng, poses: np.ndarray, points: np.ndarray, binary: bool, skipped: int | None = None) -> None:
    write_frames(folder / "images", rng, COUNT)
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    quats = [Rotation.from_matrix(pose[:3, :3]).as_quat()[[3, 0, 1, 2]] for pose in poses]
    taken = [i for i in range(COUNT) if i != skipped]
    if binary:
        (model / "cameras.bin").write_bytes(struct.pack("<Q", 1) + struct.pack("<IiQQ4d", 7, 1, WIDTH, HEIGHT, FX, FY, CX, CY))
        images = struct.pack("<Q", len(taken))
        for i in taken:
            images += struct.pack("<I7dI", i + 1, *quats[i], *poses[i][:3, 3], 7) + f"{i:06d}.png".encode() + b"\0"
            images += struct.pack("<Q", 1) + struct.pack("<2dq", 1.0, 2.0, -1)
        (model / "images.bin").write_bytes(images)
        places = [struct.pack("<Q3d3BdQ", n, *point, 1, 2, 3, 0.5, 1) + struct.pack("<II", 1, 0) for n, point in enumerate(points)]
        (model / "points3D.bin").write_bytes(struct.pack("<Q", len(points)) + b"".join(places))
        return
    (model / "cameras.txt").write_text(f"# a comment\n7 PINHOLE {WIDTH} {HEIGHT} {FX} {FY} {CX} {CY}\n")
    lines = [" ".join(map(repr, [i + 1, *map(float, (*quats[i], *poses[i][:3, 3])), 7])) + f" {i:06d}.png\n1.0 2.0 -1\n" for i in taken]
    (model / "images.txt").write_text("# a comment\n" + "".join(lines))
    places = [f"{n} {' '.join(map(repr, map(float, point)))} 1 2 3 0.5 1 0\n" for n, point in enumerate(points)]
    (model / "points3D.txt").write_text("".join(places))


def check(clip, poses: np.ndarray, points: np.ndarray, scale: float = 1.0) -> None:
    """Every camera sees points where the written ones did; the first stands at the origin."""
    assert len(clip) == len(poses)
    np.testing.assert_allclose(clip.cameras[0].viewmat, np.eye(4), atol=1e-9)
    in_first = (points @ poses[0][:3, :3].T + poses[0][:3, 3]) / scale
    for camera, pose in zip(clip.cameras, poses, strict=True):
        local = points @ pose[:3, :3].T + pose[:3, 3]
        pixels, depths = camera.project(in_first)
        np.testing.assert_allclose(pixels, local[:, :2] / local[:, 2:] * [FX, FY] + [CX, CY], atol=1e-6)
        np.testing.assert_allclose(depths * scale, local[:, 2], atol=1e-6)
    assert clip.poses == "given"


@pytest.mark.parametrize("name", ["images/{:06d}.png", "./images/{:06d}"])
def test_nerfstudio(tmp_path, rng, poses, points, name):
    write_nerfstudio(tmp_path, rng, poses, name)
    assert detect(tmp_path) == "nerfstudio"
    clip = open_clip(tmp_path)
    check(clip, poses, points)
    assert clip.provenance["focal"] == "80 pixels, from transforms.json"


@pytest.mark.parametrize("binary", [True, False])
def test_colmap(tmp_path, rng, poses, points, binary):
    write_colmap(tmp_path, rng, poses, points, binary)
    assert detect(tmp_path) == "colmap"
    depths = points @ poses[0][2, :3] + poses[0][2, 3]
    clip = open_clip(tmp_path)
    check(clip, poses, points, float(np.median(depths)))
    assert "median depth of 1" in clip.provenance["poses"]


def test_frames_without_a_pose_are_left_out(tmp_path, rng, poses, points):
    write_colmap(tmp_path, rng, poses, points, True, skipped=2)
    clip = open_clip(tmp_path)
    assert [file.name for file in clip.pictures.files] == ["000000.png", "000001.png", "000003.png", "000004.png"]


def test_distortion_is_taken_out(tmp_path, rng, poses):
    write_nerfstudio(tmp_path, rng, poses, k1=-0.2, k2=0.05, p1=0.01)
    bent = cv2.cvtColor(cv2.imread(str(tmp_path / "images" / "000002.png")), cv2.COLOR_BGR2RGB)
    matrix = np.array([[FX, 0, CX - 0.5], [0, FY, CY - 0.5], [0, 0, 1]])
    clip = open_clip(tmp_path)
    shown = clip.frame(2)
    for x, y in ((20, 20), (70, 45), (48, 32)):
        ray = np.array([[[(x - matrix[0, 2]) / FX, (y - matrix[1, 2]) / FY, 1.0]]])
        [[place]], _ = cv2.projectPoints(ray[0], np.zeros(3), np.zeros(3), matrix, np.array([-0.2, 0.05, 0.01, 0.0]))
        wanted = cv2.getRectSubPix(bent, (1, 1), tuple(map(float, place)))[0, 0]
        assert np.abs(shown[y, x].astype(int) - wanted).max() <= 3
    assert "distortion taken out" in clip.provenance["frames"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"frames": 3}, "no list of 'frames'"),
        ({"frames": []}, "poses of 0 pictures"),
        ({"frames": [{"file_path": "images/000000.png", "transform_matrix": [[1, 2], [3]]}]}, "no matrix|no rigid"),
        ({"frames": [{"file_path": "images/000000.png", "transform_matrix": np.zeros((4, 4)).tolist()}]}, "no rigid"),
        ({"frames": [{"file_path": "../outside.png", "transform_matrix": np.eye(4).tolist()}]}, "leads out of the clip"),
        ({"frames": [{"file_path": "/etc/passwd", "transform_matrix": np.eye(4).tolist()}]}, "leads out of the clip"),
        ({"frames": [{"file_path": 5, "transform_matrix": np.eye(4).tolist()}]}, "no 'file_path'"),
        ({"fl_x": float("nan")}, "NaN is no number"),
        ({"fl_x": -3.0}, "without a size or focal length"),
        ({"w": 500}, "500 × 64 pixels, but the frames"),
        ({"camera_model": "OPENCV_FISHEYE"}, "undistort the pictures first"),
    ],
)
def test_what_is_no_transforms_file_is_refused(tmp_path, rng, poses, values, message):
    write_nerfstudio(tmp_path, rng, poses, **values)
    with pytest.raises(ClipError, match=message):
        open_clip(tmp_path)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("images.bin", lambda data: struct.pack("<Q", 2**60) + data[8:], "promises"),
        ("images.bin", lambda data: data[:-20], "promises|cut short"),
        ("images.bin", lambda data: data.replace(b"000000.png", b"../../x.pn"), "leads out|not a regular file"),
        ("images.bin", lambda data: data[:12] + struct.pack("<4d", 0, 0, 0, 0) + data[44:], "no usable pose"),
        ("images.bin", lambda data: data[:8], "promises"),
        ("cameras.bin", lambda data: data[:12] + struct.pack("<i", 5) + data[16:], "undistort the pictures first"),
        ("cameras.bin", lambda data: data[:16] + struct.pack("<QQ", 2**50, 2**50) + data[32:], "without a size|pixels"),
        ("points3D.bin", lambda data: struct.pack("<Q", 2**50) + data[8:], "promises"),
    ],
)
def test_a_damaged_model_is_refused(tmp_path, rng, poses, points, name, change, message):
    write_colmap(tmp_path, rng, poses, points, True)
    file = tmp_path / "sparse" / "0" / name
    file.write_bytes(change(file.read_bytes()))
    with pytest.raises(ClipError, match=message):
        open_clip(tmp_path)
