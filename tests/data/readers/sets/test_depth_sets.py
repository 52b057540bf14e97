"""SERV-CT and C3VD, in made-up trees of their layouts: metric depth, cameras, and a lens that is no pinhole."""

import json

import numpy as np
import pytest
from PIL import Image

from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.readers import detect, open_clip
from degense.engine.data.readers.c3vd import AFFINE, CENTRE, POLYNOMIAL, SIZE, lens_of
from degense.engine.data.readers.detect import list_clips
from tests.data.readers.makers import HEIGHT, WIDTH, fails, save, tissue


def write_servct(folder, reference="Ground_truth_CT"):
    for k in (1, 2, 3):
        save(folder / "Left_rectified" / f"{k:03d}.png", tissue(np.random.default_rng(k)))
        depth = np.full((HEIGHT, WIDTH), 256 * 80 + 64 * k, np.uint16)
        depth[0] = 0
        save(folder / reference / "DepthL" / f"{k:03d}.png", depth)
        (folder / "Rectified_calibration").mkdir(exist_ok=True)
        lens = [90.0 + k, 0, 47.0, 0, 0, 91, 31, 0, 0, 0, 1, 0]
        (folder / "Rectified_calibration" / f"{k:03d}.json").write_text(json.dumps({"P1": {"rows": 3, "cols": 4, "data": lens}}))
    return folder


@pytest.mark.parametrize("reference", ["Ground_truth_CT", "Reference_CT"])
def test_servct_has_depth_in_millimetres_and_a_camera_for_each_still(tmp_path, reference):
    folder = write_servct(tmp_path / "Experiment_1", reference)
    assert detect(folder) == "servct"
    clip = open_clip(folder)
    assert (len(clip), clip.size, clip.unit, clip.depth_measured, clip.poses) == (3, (WIDTH, HEIGHT), "mm", True, "auto")
    assert clip.depth(1)[5, 5] == 80.5
    assert clip.depth(1)[0, 5] == 0
    assert [camera.fx for camera in clip.cameras] == [91, 92, 93]
    assert (clip.cameras[0].fy, clip.cameras[0].cx) == (91, 47.5)
    assert [entry.layout for entry in list_clips(tmp_path)] == ["servct"]
    (folder / "Rectified_calibration" / "002.json").write_text('{"P1": {"data": [1]}}')
    fails(folder, "P1")


def test_servct_without_its_reference_is_named(tmp_path):
    folder = write_servct(tmp_path, "Elsewhere")
    fails(folder, "Ground_truth_CT/DepthL")


def rays(size):
    """Slope x/z and y/z of each pixel of a frame of C3VD, as its own loader has them, scaled to a size."""
    scale = size[0] / SIZE[0]
    x, y = np.meshgrid(*((np.arange(side) + 0.5) / scale - 0.5 for side in size))
    u = np.stack([x - CENTRE[0], y - CENTRE[1]], -1) @ np.linalg.inv(np.array(AFFINE)).T
    rho = np.linalg.norm(u, axis=-1)
    z = POLYNOMIAL[0] + POLYNOMIAL[1] * rho**2 + POLYNOMIAL[2] * rho**3 + POLYNOMIAL[3] * rho**4
    return u / z[..., None]


def write_c3vd(folder, size=(135, 108), turned=False):
    """Three frames whose red and green tell the slope of a pixel's ray, 50 mm before a wall; the camera goes 2 mm to the right a frame."""
    slopes = rays(size)
    colour = np.full((*slopes.shape[:2], 3), 90.0)
    colour[..., :2] = 128 + 60 * np.clip(slopes, -2, 2)
    poses = []
    for k in range(3):
        save(folder / f"{k}_color.png", colour.round().astype(np.uint8))
        depth = np.full(slopes.shape[:2], round(50 / 100 * 65535), np.uint16)
        depth[0], depth[-1] = 0, 65535
        Image.fromarray(depth).save(folder / f"{k:04d}_depth.tiff")
        pose = np.eye(4)
        pose[0, 3] = 5 + 2 * k
        poses.append(pose if turned else pose.T)
    (folder / "pose.txt").write_text("\n".join(",".join(f"{value:.6f}" for value in pose.ravel()) for pose in poses) + "\n")
    return folder


@pytest.mark.parametrize("turned", [False, True])
def test_c3vd_is_resampled_to_a_pinhole_camera(tmp_path, turned):
    folder = write_c3vd(tmp_path, turned=turned)
    assert detect(folder) == "c3vd"
    clip = open_clip(folder)
    camera = clip.cameras[0]
    assert (len(clip), clip.size, clip.unit, clip.depth_measured, clip.poses) == (3, (135, 108), "mm", True, "given")
    x, y = np.meshgrid(np.arange(135) + 0.5, np.arange(108) + 0.5)
    slopes = camera.unproject(np.stack([x, y], -1), np.ones_like(x))[..., :2]
    shown = (clip.frame(0)[..., :2].astype(float) - 128) / 60
    assert np.abs(shown - slopes)[5:-5, 5:-5].max() < 0.03
    assert clip.depth(0)[50, 60] == pytest.approx(50, abs=0.001)
    np.testing.assert_allclose(clip.cameras[2].viewmat[:3, 3], [-4, 0, 0], atol=1e-6)
    wide = open_clip(folder, ClipOptions(focal=20.0))
    assert wide.cameras[0].fx == 20
    assert (wide.depth(0)[[0, -1], 67] == 0).all()  # nothing was stored so far out
    assert wide.depth(0).max() < 51  # the largest value says nothing


def test_the_lens_is_exact_in_the_middle_at_full_size():
    places = lens_of(SIZE, POLYNOMIAL[0])
    near = np.abs(places - CENTRE).sum(-1).argmin()
    row, column = divmod(int(near), SIZE[0])
    assert (row, column) in {(539, 674), (539, 675), (540, 674), (540, 675)}


def test_damaged_videos_of_c3vd_are_refused(tmp_path):
    folder = write_c3vd(tmp_path)
    poses = (folder / "pose.txt").read_text()
    for text in ("1,2,3\n", "a" + poses, poses.splitlines()[0], poses.replace("1.000000", "2.000000")):
        (folder / "pose.txt").write_text(text)
        fails(folder, "pose.txt")
    (folder / "pose.txt").write_text(poses)
    (folder / "0001_depth.tiff").unlink()
    fails(folder, "2 depth maps")
