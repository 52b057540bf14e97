"""Folders are recognised, and what is read is what was written."""

import json

import cv2
import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import ClipOptions, describe, detect, open_clip
from degense.engine.latest import Latest
from tests.data.readers.makers import HEIGHT, WIDTH, save, tissue, tool, write_camera, write_endonerf, write_frames, write_poses


def test_endonerf_frames_masks_and_focal(tmp_path):
    frames = write_endonerf(tmp_path, np.random.default_rng(1))
    clip = open_clip(tmp_path)
    assert detect(tmp_path) == "endonerf"
    assert len(clip) == 5
    assert clip.size == (WIDTH, HEIGHT)
    for i, frame in enumerate(frames):
        np.testing.assert_array_equal(clip.frame(i), frame)
        np.testing.assert_array_equal(clip.valid(i), ~tool(i))
    camera = clip.cameras[0]
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (80, 80, WIDTH / 2, HEIGHT / 2)
    assert clip.cameras[4] is camera
    assert "stands still" in clip.provenance["poses"]
    assert clip.provenance["masks"].startswith("masks/: 255 = tool (excluded area ")
    assert "moves between frames" in clip.provenance["masks"]


def test_endonerf_file_names_need_not_agree(tmp_path):
    rng = np.random.default_rng(2)
    write_frames(tmp_path / "images", rng, 12, name="frame-{:d}.color.png")
    for i in range(12):
        save(tmp_path / f"gt_masks/frame-{i}.mask.png", (tool(i) * 255).astype(np.uint8))
    write_poses(tmp_path, 12)
    clip = open_clip(tmp_path)
    np.testing.assert_array_equal(clip.valid(10), ~tool(10))  # 10 comes after 9, not after 1


def test_focal_is_scaled_with_the_pictures_and_can_be_set(tmp_path):
    write_endonerf(tmp_path, np.random.default_rng(3))
    write_poses(tmp_path, 5, hwf=(HEIGHT * 2, WIDTH * 2, 200.0))
    assert open_clip(tmp_path).cameras[0].fx == pytest.approx(100)
    clip = open_clip(tmp_path, ClipOptions(focal=321.0))
    assert clip.cameras[0].fx == 321
    assert "as set" in clip.provenance["focal"]


def test_endonerf_depth_is_clipped_to_robust_percentiles(tmp_path):
    rng = np.random.default_rng(4)
    write_endonerf(tmp_path, rng)
    depth = rng.integers(1000, 2000, (HEIGHT, WIDTH)).astype(np.uint16)
    depth[:4] = 0
    depth[10, 10] = 65000
    for i in range(5):
        save(tmp_path / f"depth/{i:06d}.png", depth)
    clip = open_clip(tmp_path)
    read = clip.depth(2)
    low, high = np.percentile(depth[depth > 0], [3, 99.8])
    assert clip.depth_measured
    assert read.dtype == np.float32
    assert (read[:4] == 0).all()
    known = read[depth > 0]
    assert known.min() == pytest.approx(low, rel=0.02)
    assert known.max() == pytest.approx(high, rel=0.02)
    middle = (depth > low * 1.05) & (depth < high * 0.95)
    np.testing.assert_array_equal(read[middle], depth[middle])


def test_frames_with_everything(tmp_path):
    rng = np.random.default_rng(5)
    frames = write_frames(tmp_path / "images", rng, 4)
    (tmp_path / "depth").mkdir()
    depth = rng.uniform(40, 90, (4, HEIGHT, WIDTH)).astype(np.float32)
    depth[:, 0, :4] = [np.nan, np.inf, -1, 0]
    for i in range(4):
        np.save(tmp_path / f"depth/{i:06d}.npy", depth[i])
    labels = rng.integers(0, 3, (HEIGHT, WIDTH)).astype(np.uint8)
    labels[:3] = UNLABELLED
    save(tmp_path / "labels/000002.png", labels)
    (tmp_path / "classes.json").write_text(json.dumps({"classes": ["a", "b", "c"]}))
    displacement = rng.standard_normal((4, HEIGHT, WIDTH, 3)).astype(np.float32)
    cautery = rng.random((4, HEIGHT, WIDTH)) < 0.1
    np.savez_compressed(tmp_path / "gt.npz", displacement=displacement, cautery=cautery)
    angle = np.radians(10)
    viewmats = np.tile(np.eye(4), (4, 1, 1))
    viewmats[2:, :2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    write_camera(tmp_path, viewmats=viewmats.tolist())

    clip = open_clip(tmp_path)
    assert detect(tmp_path) == "frames"
    np.testing.assert_array_equal(clip.frame(3), frames[3])
    expected = depth[1].copy()
    expected[0, :4] = 0
    np.testing.assert_array_equal(clip.depth(1), expected)
    assert clip.labelled_frames == [2]
    np.testing.assert_array_equal(clip.labels(2), labels)
    assert clip.labels(1) is None
    assert clip.classes == ("a", "b", "c")
    truth = clip.truth()
    np.testing.assert_array_equal(truth.displacement, displacement)
    np.testing.assert_array_equal(truth.cautery, cautery)
    assert (clip.cameras[0].fx, clip.cameras[0].fy, clip.cameras[0].cx, clip.cameras[0].cy) == (90, 91, 47, 33)
    np.testing.assert_array_equal(clip.cameras[3].viewmat, viewmats[3])
    assert "moves" in clip.provenance["poses"]
    text = describe(clip)
    assert all(key in text for key in ("frames", "poses", "focal", "masks", "depth", "labels", "classes a, b, c"))


def test_loose_pictures_in_the_folder_itself(tmp_path):
    frames = write_frames(tmp_path, np.random.default_rng(6), 3, name="shot {:d}.png")
    clip = open_clip(tmp_path)
    np.testing.assert_array_equal(clip.frame(1), frames[1])
    assert clip.valid(0).all()
    assert clip.provenance["focal"].startswith("assumed")
    assert clip.cameras[0].fx == pytest.approx(np.hypot(WIDTH, HEIGHT) / 2 / np.tan(np.radians(35)))


def test_palette_label_maps_give_their_indices(tmp_path):
    from PIL import Image

    write_frames(tmp_path / "images", np.random.default_rng(7), 3)
    labels = np.zeros((HEIGHT, WIDTH), np.uint8)
    labels[10:20] = 1
    picture = Image.fromarray(labels, "P")
    picture.putpalette([10, 20, 30, 200, 100, 50])
    (tmp_path / "labels").mkdir()
    picture.save(tmp_path / "labels/000000.png")
    (tmp_path / "classes.json").write_text('{"classes": ["tissue", "tool"]}')
    np.testing.assert_array_equal(open_clip(tmp_path).labels(0), labels)


def test_frames_are_the_callers_own(tmp_path):
    write_frames(tmp_path, np.random.default_rng(8), 2)
    clip = open_clip(tmp_path)
    before = clip.frame(0)
    clip.frame(0)[:] = 0
    clip.valid(0)[:] = False
    np.testing.assert_array_equal(clip.frame(0), before)
    assert clip.valid(0).all()
    with pytest.raises(IndexError):
        clip.frame(2)
    with pytest.raises(IndexError):
        clip.frame(-1)


def test_the_cache_keeps_what_fits():
    cache = Latest(3000)
    loads = []

    def get(key, size=1000):
        return cache.get(key, lambda: loads.append(key) or np.zeros(size, np.uint8), lambda array: array.nbytes)

    for key in "abcab":
        get(key)
    assert loads == ["a", "b", "c"]
    get("d")  # c was used longest ago
    get("a")
    get("c")
    assert loads == ["a", "b", "c", "d", "c"]
    assert cache.size <= 3000
    get("huge", 5000)
    assert cache.size == 5000
    get("a")
    assert loads[-2:] == ["huge", "a"]
    assert cache.size == 1000


def test_a_picture_with_alpha_and_a_grey_one_are_frames_too(tmp_path):
    rng = np.random.default_rng(9)
    rgb = tissue(rng)
    save(tmp_path / "0.png", np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)]))
    save(tmp_path / "1.png", cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
    clip = open_clip(tmp_path)
    np.testing.assert_array_equal(clip.frame(0), rgb)
    assert clip.frame(1).shape == rgb.shape
