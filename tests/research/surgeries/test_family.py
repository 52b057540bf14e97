"""Surgeries of the family: diverse, the same from the same seed, and exact, judged from the files alone."""

import json

import numpy as np
import pytest

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import ClipError
from degense.engine.research.surgeries import DEVELOP, REPORT, draw_plan
from tests.data.synthetic.files import load
from tests.data.synthetic.test_phantom import inside, look_up

SEEDS = (1, 2, 3, 14)


@pytest.fixture(scope="module", params=SEEDS)
def surgery(request, tmp_path_factory):
    out = tmp_path_factory.mktemp("family") / str(request.param)
    make_phantom(out, PhantomOptions(frames=5, width=128, height=96, kind="family", seed=request.param))
    return out


def test_sets_share_no_seed():
    assert not set(DEVELOP) & set(REPORT)


def test_seeds_draw_all_that_happens_in_surgery():
    plans = [draw_plan(seed) for seed in DEVELOP]
    assert {len(plan.organs) for plan in plans} >= {2, 3, 4, 5, 6}
    assert {plan.camera for plan in plans} == {"still", "orbit", "hand-held"}
    burns = [burn for plan in plans for burn in plan.burns]
    kinds = {(burn.edge > 0.45, burn.hook, burn.static, plan.texture < 0.3) for plan in plans for burn in plan.burns}
    assert len(kinds) >= 15, "soft and sharp, with a hook and without, on static and moving, on plain and textured tissue"
    assert len(burns) > 50
    assert min(burn.radius for burn in burns) < 4 < 11 < max(burn.radius for burn in burns)
    assert all(any(happens) for happens in zip(*((p.cut, p.blood, p.smoke > 0, p.jpeg < 100) for p in plans), strict=True))
    assert any(not plan.tools for plan in plans)
    assert any(len(plan.tools) >= 3 for plan in plans)
    assert len({plan.words() for plan in plans}) > 90


def test_seen_points_go_back_to_the_surface_of_frame_0(surgery):
    phantom = load(surgery)
    for frame in range(len(phantom.images)):
        tissue = np.isfinite(phantom.displacement[frame]).all(-1)
        points = (phantom.world(frame) - phantom.displacement[frame])[tissue]
        pixels, z = phantom.pixels(points, 0)
        seen = inside(pixels, phantom.depth.shape[1:])
        error = np.abs(look_up(phantom.depth[0], pixels[seen]) - z[seen])
        assert seen.mean() > 0.7
        assert np.median(error) < 0.02
        assert np.percentile(error, 90) < 0.6  # what a tool hid at frame 0, or a cut lays open, lies elsewhere


def test_tracks_agree_with_displacement_and_depth(surgery):
    truth, phantom = open_clip(surgery).truth(), load(surgery)
    assert truth.tracks.shape == (256, 5, 3)
    assert 0.3 < truth.visible.mean() <= 1.0
    for frame in range(5):
        seen = truth.visible[:, frame]
        pixels, z = phantom.pixels(truth.tracks[seen, frame], frame)
        row, column = np.floor(pixels[:, ::-1]).astype(int).T
        assert np.median(np.abs(phantom.depth[frame][row, column] - z)) < 0.2
        moved = truth.tracks[seen, frame] - truth.tracks[seen, 0]
        assert np.nanmedian(np.linalg.norm(phantom.displacement[frame][row, column] - moved, axis=-1)) < 0.05


def test_tissue_changes_only_where_the_truth_says_so(surgery):
    phantom = load(surgery)
    assert not phantom.cautery[0].any()
    for name in ("charred tissue", "blood"):
        if name in phantom.classes:
            assert (phantom.cautery | (phantom.labels != phantom.classes.index(name))).all()
    assert (phantom.labels != 255).all(), "the tissue fills the view"


def test_a_seed_gives_the_same_bytes_and_another_looks_otherwise(tmp_path):
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        make_phantom(tmp_path / name, PhantomOptions(frames=2, width=64, height=48, kind="family", seed=seed))
    files = [path.relative_to(tmp_path / "a") for path in sorted((tmp_path / "a").rglob("*")) if path.is_file()]
    same = [(tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes() for name in files]
    assert all(same)
    assert (tmp_path / "a" / "images" / "000001.png").read_bytes() != (tmp_path / "c" / "images" / "000001.png").read_bytes()


def test_the_folder_says_what_it_shows_and_what_could_be_scored(surgery):
    facts = json.loads((surgery / "surgery.json").read_text())
    assert 30 < facts["psnr_ceiling"] < 52
    assert "organs" in facts["words"]
    assert facts["plan"]["seed"] == facts["seed"]


def test_stereo_depth_has_holes_and_errors_and_none_has_no_depth(tmp_path):
    for depth in ("exact", "noisy", "none"):
        make_phantom(tmp_path / depth, PhantomOptions(frames=2, width=128, height=96, kind="family", seed=2, depth=depth))
    exact, noisy = (np.load(tmp_path / which / "depth" / "000001.npy") for which in ("exact", "noisy"))
    known = noisy > 0
    assert 0.5 < known.mean() < 1.0
    assert 0.1 < np.median(np.abs(noisy - exact)[known]) < 3.0
    assert not (tmp_path / "none" / "depth").exists()
    assert not open_clip(tmp_path / "none").depth_measured


def test_tracks_of_another_shape_are_refused(tmp_path):
    make_phantom(tmp_path / "clip", PhantomOptions(frames=2, width=64, height=48, kind="family", seed=4))
    with np.load(tmp_path / "clip" / "gt.npz") as archive:
        arrays = dict(archive)
    arrays["tracks"] = arrays["tracks"][:, :1]
    np.savez(tmp_path / "clip" / "gt.npz", **arrays)
    with pytest.raises(ClipError, match="tracks"):
        open_clip(tmp_path / "clip")
