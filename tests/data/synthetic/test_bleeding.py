"""The kind "bleeding": the cut opens, blood comes and goes, tissue under it moves as it would without, judged from the files alone."""

import json

import cv2
import numpy as np
import pytest
from PIL import Image

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from tests.data.synthetic.files import load
from tests.data.synthetic.test_phantom import inside, look_up

COVERED, PARENCHYMA, BLOOD, SCISSORS = 0, 1, 5, 6
SHAPE = {"width": 160, "height": 128, "seed": 5, "kind": "bleeding", "noise": 0.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("phantom") / "bleeding"
    make_phantom(out, PhantomOptions(frames=11, tool_masks=True, **SHAPE))
    return out


@pytest.fixture(scope="module")
def phantom(folder):
    return load(folder)


def test_surface_points_go_back_to_frame_0_and_the_bed_to_beneath_it(phantom):
    for frame in range(11):
        tissue = np.isfinite(phantom.displacement[frame]).all(-1)
        pixels, z = phantom.pixels((phantom.world(frame) - phantom.displacement[frame])[tissue], 0)
        seen = inside(pixels, phantom.depth.shape[1:])
        deeper = z[seen] - look_up(phantom.depth[0], pixels[seen])
        surface = np.abs(deeper) < 0.4
        assert np.median(np.abs(deeper[surface])) < 0.01
        assert surface.mean() > 0.94
        rest = deeper[~surface]
        assert np.median(rest) == pytest.approx(2.6, abs=0.4) if len(rest) > 60 else True, "what the cut lays open lay 2.6 mm below"
    tissue = np.isfinite(phantom.displacement[-1]).all(-1)
    _, z = phantom.pixels((phantom.world(-1) - phantom.displacement[-1])[tissue], 0)
    assert phantom.labels[-1][tissue][z - phantom.depth[0][tissue] > 2].size > 100


def test_the_cut_parts_and_gapes(phantom):
    """Across the cut the displacement jumps: the upper lip goes up, the lower one down."""
    moved = phantom.displacement[-1][..., 1] - np.nanmedian(phantom.displacement[-1][..., 1])
    assert np.nanmin(moved) < -1.5
    assert np.nanmax(moved) > 1.5
    cut = (phantom.labels == PARENCHYMA)[:, 30:90, 20:105].sum((1, 2))
    assert cut[0] == cut[1] == 0
    assert cut.max() > 60
    norm = np.linalg.norm(phantom.displacement, axis=-1)
    assert np.all(norm[0][np.isfinite(norm[0])] == 0)
    assert 3 < np.nanmax(norm) < 8


def test_blood_wells_up_spreads_and_is_sucked_away(phantom):
    bled, called = phantom.cautery.sum((1, 2)), (phantom.labels == BLOOD).sum((1, 2))
    assert bled[:3].sum() == 0
    assert bled[-1] > 600
    assert called.max() > 300
    assert called[-1] < 0.8 * called.max(), "suction leaves a stain that is not called blood"
    assert (phantom.cautery | (phantom.labels != BLOOD)).all()
    colours = phantom.images[np.argmax(called)][phantom.labels[np.argmax(called)] == BLOOD].astype(float)
    assert np.median(colours[:, 0]) > 2.5 * np.median(colours[:, 1])


def test_tissue_under_blood_moves_as_the_tissue_beside_it(phantom):
    jumps = []
    for frame in range(5, 11):
        rim = cv2.dilate(phantom.cautery[frame].astype(np.uint8), np.ones((3, 3))) > 0
        norm = phantom.displacement[frame]
        across = np.abs(np.diff(norm, axis=1)).max(-1)[:, :]
        border = phantom.cautery[frame][:, 1:] != phantom.cautery[frame][:, :-1]
        jumps.append(np.nanmedian(across[border]))
        assert rim.any()
    assert max(jumps) < 0.15
    assert np.linalg.norm(phantom.displacement[phantom.cautery], axis=-1).mean() > 0.5, "it breathes"


def test_tool_masks_mark_every_pixel_that_a_tool_shows_in(folder, phantom):
    """Pixels at an edge are mixed: scored as tissue, they would cost a perfect reconstruction most of a decibel."""
    for frame in (0, 4, 9):
        mask = np.array(Image.open(folder / "masks" / f"{frame:06d}.png"))
        assert set(np.unique(mask)) <= {0, 255}
        tools = phantom.labels[frame] >= SCISSORS
        assert np.array_equal(tools, np.isnan(phantom.displacement[frame]).any(-1))
        assert (mask > 0)[tools].all()
        edge = (mask > 0) & ~tools
        assert edge.sum() >= 0.01 * tools.sum()
        assert not (edge & (cv2.dilate(tools.astype(np.uint8), np.ones((3, 3))) == 0)).any()
    clip = open_clip(folder)
    assert np.array_equal(clip.valid(9), np.array(Image.open(folder / "masks" / "000009.png")) == 0)


def test_names_are_in_the_vocabulary_and_thin_tools_are_thin(folder, phantom):
    from degense.engine.semantics import EmbeddedEncoder

    classes = json.loads((folder / "classes.json").read_text())["classes"]
    assert EmbeddedEncoder(classes).literal == ()
    assert set(np.unique(phantom.labels)) == set(range(8))
    tube = (phantom.labels[9] == 7).astype(np.uint8)
    assert tube.sum() > 100
    assert cv2.distanceTransform(tube, cv2.DIST_L2, 5).max() < 4


def test_same_seed_same_bytes(tmp_path):
    options = PhantomOptions(frames=2, width=64, height=48, seed=3, kind="bleeding", camera_motion=3.0)
    make_phantom(tmp_path / "a", options)
    make_phantom(tmp_path / "b", options)
    names = [p.relative_to(tmp_path / "a") for p in (tmp_path / "a").rglob("*") if p.is_file()]
    assert len(names) == 2 * 3 + 3
    assert all((tmp_path / "a" / n).read_bytes() == (tmp_path / "b" / n).read_bytes() for n in names)


def test_the_older_kind_is_what_it_was(tmp_path):
    """Numbers noted before there was a second kind (coarse, because processors round differently)."""
    make_phantom(tmp_path / "a", PhantomOptions(frames=3, width=64, height=48, seed=9, camera_motion=2.0))
    phantom = load(tmp_path / "a")
    coarse = phantom.images[2].reshape(2, 24, 4, 16, 3).mean((1, 3))
    then = [
        [[76.1, 28.7, 28.7], [93.2, 49.0, 45.2], [167.6, 135.7, 108.3], [100.1, 74.1, 66.4]],
        [[108.4, 73.3, 60.0], [150.6, 113.9, 78.9], [138.6, 99.8, 67.7], [79.0, 37.4, 34.1]],
    ]
    np.testing.assert_allclose(coarse, then, atol=0.1)
    np.testing.assert_allclose(np.bincount(phantom.labels[2].ravel()), [113, 1319, 935, 427, 185, 27, 66], atol=2)
    np.testing.assert_allclose(np.nanmean(np.abs(phantom.displacement[1]), (0, 1)), [0.94624, 0.98250, 1.25461], atol=1e-3)
