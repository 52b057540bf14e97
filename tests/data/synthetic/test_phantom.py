"""The phantom's colour, depth, labels and displacement agree with each other and with physics, judged from the files alone."""

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import map_coordinates

from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import Cancelled, DegenseError
from tests.data.synthetic.files import load


def look_up(image, pixels):
    return map_coordinates(image, [pixels[..., 1] - 0.5, pixels[..., 0] - 0.5], order=1, mode="nearest")


def inside(pixels, shape, margin=1.0):
    return (pixels > margin).all(-1) & (pixels[..., 0] < shape[1] - margin) & (pixels[..., 1] < shape[0] - margin)


@pytest.mark.parametrize("which", ["still", "moving"])
def test_every_seen_point_goes_back_to_the_surface_of_frame_0(which, request):
    phantom = load(request.getfixturevalue(which))
    for frame in range(len(phantom.images)):
        tissue = np.isfinite(phantom.displacement[frame]).all(-1)
        points = (phantom.world(frame) - phantom.displacement[frame])[tissue]
        pixels, z = phantom.pixels(points, 0)
        seen = inside(pixels, phantom.depth.shape[1:])
        assert seen.mean() > 0.7
        error = np.abs(look_up(phantom.depth[0], pixels[seen]) - z[seen])
        # Depth is looked up between pixels, so creases leave an error; a wrong displacement of half a millimetre would not pass.
        assert np.median(error) < 0.01
        assert np.percentile(error, 99) < 0.15


@pytest.mark.parametrize("which", ["still", "moving"])
def test_colour_travels_with_the_tissue(which, request):
    phantom = load(request.getfixturevalue(which))
    first = phantom.images[0].astype(float)
    for frame in range(1, len(phantom.images)):
        tissue = np.isfinite(phantom.displacement[frame]).all(-1) & ~phantom.cautery[frame]
        here = phantom.images[frame].astype(float)[tissue]
        pixels, _ = phantom.pixels((phantom.world(frame) - phantom.displacement[frame])[tissue], 0)
        seen = inside(pixels, phantom.depth.shape[1:])
        there = np.stack([look_up(first[..., i], pixels[seen]) for i in range(3)], -1)
        # Light moves with the camera and highlights with the slope, so colours agree up to shading.
        assert np.median(np.abs(here[seen] - there)) < 8
        follows = np.corrcoef(here[seen].ravel(), there.ravel())[0, 1]
        assert follows > 0.9
    moved = np.linalg.norm(phantom.displacement[-1], axis=-1) > 5
    unmoved = np.abs(phantom.images[-1].astype(float) - first)[moved].mean()
    pixels, _ = phantom.pixels((phantom.world(-1) - phantom.displacement[-1])[moved], 0)
    followed = np.mean([np.abs(phantom.images[-1][..., i][moved] - look_up(first[..., i], pixels)).mean() for i in range(3)])
    assert followed < 0.7 * unmoved


@pytest.mark.parametrize("which", ["still", "moving"])
def test_tissue_chars_in_place(which, request):
    phantom = load(request.getfixturevalue(which))
    assert phantom.cautery[-1].sum() > 100
    assert not phantom.cautery[0].any()
    assert np.nanmax(np.abs(phantom.displacement[phantom.cautery])) < 1e-6
    charred = phantom.labels == phantom.classes.index("charred tissue")
    assert charred[-1].sum() > 60
    assert (phantom.cautery | ~charred).all(), "what is called charred has begun to char"
    assert phantom.images[-1][charred[-1]].mean() < 0.4 * phantom.images[0][charred[-1]].mean()
    tools = phantom.labels >= phantom.classes.index("grasper")
    assert np.isnan(phantom.displacement[tools]).all()
    assert np.isfinite(phantom.displacement[~tools]).all()
    assert not (phantom.cautery & tools).any()


def test_charred_pixels_stay_charred(still):
    phantom = load(still)
    tissue = np.isfinite(phantom.displacement).all(-1)
    for before, after in zip(range(10), range(1, 11), strict=True):
        assert phantom.cautery[after][phantom.cautery[before] & tissue[after]].all()


def test_grasper_pulls_and_breathing_returns(still):
    phantom = load(still)
    norm = np.linalg.norm(phantom.displacement, axis=-1)
    assert np.all(norm[0] == 0)
    assert 8 < np.nanmax(norm[-1]) < 13
    gallbladder = phantom.labels[-1] == phantom.classes.index("gallbladder")
    assert norm[-1][gallbladder].mean() > 2 > norm[-1][phantom.labels[-1] == phantom.classes.index("fat")].mean()
    assert np.nanmax(norm[-1][phantom.labels[-1] == phantom.classes.index("gallbladder")]) == np.nanmax(norm[-1])
    liver = phantom.labels == phantom.classes.index("liver")
    assert 0.3 < np.nanmean(norm[1][liver[1]]) < 2.5
    assert np.nanmean(np.abs(np.diff(np.nan_to_num(norm[:, 3, 3])))) > 0.05, "a corner breathes"


def test_labels_cover_tissues_and_tools(still):
    phantom = load(still)
    assert phantom.classes == [
        "abdominal wall",
        "liver",
        "gallbladder",
        "fat",
        "connective tissue",
        "charred tissue",
        "grasper",
        "L-hook electrocautery",
    ]
    assert set(np.unique(phantom.labels)) == set(range(8))
    assert all((phantom.labels[0] == i).mean() > 0.02 for i in range(5))
    assert phantom.depth.min() > 20
    assert phantom.depth.max() < 125
    assert 60 < np.median(phantom.depth) < 120
    picture = Image.open(still / "labels" / "000005.png")
    assert picture.mode == "P"
    assert len({tuple(c) for c in np.array(picture.convert("RGB"))[::4, ::4].reshape(-1, 3)}) >= 6


def test_tools_lie_in_front_of_the_tissue_they_hide(still):
    phantom = load(still)
    tools = phantom.labels >= 6
    for frame in range(11):
        hidden = tools[frame]
        if hidden.any():
            assert (phantom.depth[frame] <= phantom.depth[0] + 3.0)[hidden].mean() > 0.98


def test_light_falls_off_with_distance(still):
    phantom = load(still)
    wall = phantom.labels[0] == 0
    light = (phantom.images[0][wall].mean(-1) / 255) ** 2.2
    depth = phantom.depth[0][wall]
    near, far = np.percentile(depth, [25, 75])
    assert light[depth < near].mean() > light[depth > far].mean()


def test_camera_starts_at_the_world_and_moves_smoothly(moving):
    phantom = load(moving)
    np.testing.assert_allclose(phantom.viewmats[0], np.eye(4), atol=1e-12)
    for matrix in phantom.viewmats:
        np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix) > 0
    centres = np.array([-m[:3, :3].T @ m[:3, 3] for m in phantom.viewmats])
    assert 8 < np.linalg.norm(centres, axis=1).max() < 16
    assert (phantom.labels != 255).all(), "the tissue fills the view"
    assert (phantom.depth > 0).all()


def test_same_seed_same_bytes_other_seed_other_scene(tmp_path):
    options = PhantomOptions(frames=3, width=64, height=48, seed=9, camera_motion=2.0)
    make_phantom(tmp_path / "a", options)
    make_phantom(tmp_path / "b", options)
    make_phantom(tmp_path / "c", PhantomOptions(frames=3, width=64, height=48, seed=10, camera_motion=2.0))
    names = sorted(p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file())
    assert len(names) == 3 * 3 + 4
    assert all((tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in names)
    differing = [n for n in names if (tmp_path / "a" / n).read_bytes() != (tmp_path / "c" / n).read_bytes()]
    assert len(differing) >= 3 * 3 + 1


def test_noise_has_the_stated_strength(tmp_path):
    shape = {"frames": 2, "width": 96, "height": 80, "seed": 3}
    make_phantom(tmp_path / "clean", PhantomOptions(noise=0, **shape))
    make_phantom(tmp_path / "noisy", PhantomOptions(noise=1.5, **shape))
    clean, noisy = load(tmp_path / "clean").images.astype(float), load(tmp_path / "noisy").images.astype(float)
    unclipped = (clean > 10) & (clean < 245)
    assert 1.4 < (noisy - clean)[unclipped].std() < 1.7


def test_cancelling_leaves_nothing(tmp_path):
    seen = []

    def stop(fraction, message):
        seen.append((fraction, message))
        if fraction > 0.4:
            raise Cancelled

    with pytest.raises(Cancelled):
        make_phantom(tmp_path / "clip", PhantomOptions(frames=4, width=64, height=48), stop)
    assert list(tmp_path.iterdir()) == []
    assert [f for f, _ in seen] == sorted(f for f, _ in seen)


def test_a_folder_in_use_is_left_alone(tmp_path):
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(DegenseError, match="not an empty folder"):
        make_phantom(tmp_path, PhantomOptions(frames=1, width=64, height=48))
    assert (tmp_path / "mine.txt").read_text() == "keep"


@pytest.mark.parametrize(
    "wrong",
    [
        {"frames": 0},
        {"width": 4},
        {"height": 5000},
        {"noise": -1},
        {"noise": float("nan")},
        {"camera_motion": 99},
        {"seed": -1},
        {"kind": "x"},
    ],
)
def test_impossible_options_are_refused_in_a_sentence(wrong):
    with pytest.raises(DegenseError, match="choose"):
        PhantomOptions(**wrong)


def test_readers_take_it(moving):
    readers = pytest.importorskip("degense.engine.data.readers")
    phantom, clip = load(moving), readers.open_clip(moving)
    assert len(clip) == 7
    assert clip.depth_measured
    np.testing.assert_array_equal(clip.labels(4), phantom.labels[4])
    np.testing.assert_array_equal(clip.frame(4), phantom.images[4])
    np.testing.assert_allclose(clip.cameras[4].viewmat, phantom.viewmats[4])
    np.testing.assert_array_equal(clip.truth().displacement, phantom.displacement)
