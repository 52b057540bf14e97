"""An opened run: its facts, its states in time, its renders, its caches."""

import dataclasses

import numpy as np
import pytest
import torch

from degense.engine.camera import Camera
from degense.engine.errors import DegenseError, PromptError
from degense.engine.latest import Latest
from degense.engine.layers import LAYERS, LayerRequest
from degense.engine.raster import Render
from degense.engine.research.raster_reference import rasterize_reference
from degense.engine.scene import Scene
from degense.engine.scene.renderer import CHANNELS


@pytest.fixture
def fresh(scene):
    """The run with empty caches."""
    return Scene(scene.run, scene.model, scene.basis, scene.encoder, scene.clip, observability=scene.observability)


def test_facts(scene, clip):
    assert scene.name == "run"
    assert scene.frames == len(clip) == 9
    assert scene.clip_size == clip.size == (64, 48)
    assert scene.classes == clip.classes
    assert scene.unit == "mm"
    assert scene.fps == clip.fps
    assert scene.reference_frame == clip.train_frames[0]
    assert scene.has_semantics
    assert [scene.time(i) for i in range(9)] == [clip.time(i) for i in range(9)]
    assert scene.time(2.5) == clip.time(2.5)
    assert np.array_equal(scene.observed(4), clip.frame(4))
    assert np.array_equal(scene.labels(4), clip.labels(4))
    for a, b in zip(scene.cameras, clip.cameras, strict=True):
        assert np.allclose([a.fx, a.fy, a.cx, a.cy], [b.fx, b.fy, b.cx, b.cy])
        assert np.allclose(a.viewmat, b.viewmat)
    assert scene.camera(3.4) is scene.cameras[3]
    assert scene.camera(-5) is scene.cameras[0]
    assert scene.camera(99) is scene.cameras[8]


def test_states_are_the_models_in_the_clips_unit(fresh):
    for frame in (0, 3, 4.5):
        splats = fresh.splats(frame, semantics=True)
        with torch.no_grad():
            model = fresh.model.at(fresh.time(frame)).splats
        unit = fresh.run.info["unit"]
        assert torch.allclose(splats.means * unit, model.means, atol=1e-5)
        assert torch.allclose(splats.scales * unit, model.scales, rtol=1e-4)
        for name in ("quats", "opacities", "colors", "semantics"):
            assert torch.equal(getattr(splats, name), getattr(model, name)), name
        assert not splats.means.requires_grad
    assert fresh.splats(3) is fresh.splats(3)


def test_states_without_latents_are_the_same_gaussians(fresh):
    bare = fresh.splats(2)
    whole = fresh.splats(2, semantics=True)
    assert bare.semantics.shape == (len(whole), 0)
    assert whole.semantics.shape[1] == fresh.basis.rank
    for name in ("means", "quats", "scales", "opacities", "colors"):
        assert torch.equal(getattr(bare, name), getattr(whole, name)), name
    assert fresh.splats(2) is whole, "what has latents serves those who need none"


def test_drifts_are_drawn_but_are_no_displacement(fresh):
    model, frame = fresh.model, 5
    before = fresh.states.displacement(frame), fresh.states.advected_means(frame)
    kept = {name: model.canonical[name].clone() for name in ("temporal_windows", "velocities")}
    with torch.no_grad():
        model.canonical["temporal_windows"].copy_(torch.tensor([fresh.time(frame) + 0.01, 0.1]))
        model.canonical["velocities"].fill_(0.5)
    try:
        there = Scene(fresh.run, model, fresh.basis, fresh.encoder, fresh.clip, observability=fresh.observability)
        assert torch.allclose(there.states.displacement(frame), before[0], atol=1e-4)
        moved = (there.splats(frame).means - before[1]) * fresh.run.info["unit"]
        assert torch.allclose(moved, torch.full_like(moved, -0.0005), atol=1e-6)
        assert torch.allclose(there.states.advected_means(frame), before[1], atol=1e-4)
        assert not LAYERS["speed"].splats(there, LayerRequest(0)).max() > LAYERS["speed"].splats(fresh, LayerRequest(0)).max() * 1.01
    finally:
        with torch.no_grad():
            for name, value in kept.items():
                model.canonical[name].copy_(value)


def test_displacement_looks_through_what_comes_and_goes(fresh):
    """As if it were not there; where nothing lasts, it counts itself."""
    model, frame, rows = fresh.model, 5, torch.randperm(len(fresh.model), generator=torch.Generator().manual_seed(0))
    brief, others = rows[: len(rows) // 3], rows[len(rows) // 3 :]
    kept = {name: model.canonical[name].clone() for name in ("temporal_windows", "logits")}

    def displacement():
        return Scene(fresh.run, model, fresh.basis, fresh.encoder, fresh.clip).render(frame, None, ("displacement",))["displacement"]

    try:
        with torch.no_grad():
            model.canonical["temporal_windows"].zero_()
            before = displacement()
            model.canonical["logits"][brief] = -30.0  # what is not seen does not count
            wanted = displacement()
            model.canonical["logits"].copy_(kept["logits"])
            model.canonical["temporal_windows"][brief] = torch.tensor([fresh.time(frame), 1e-3])
            through = displacement()
            model.canonical["temporal_windows"][others] = torch.tensor([fresh.time(frame), 1e-3])
            nothing_lasts = displacement()
    finally:
        with torch.no_grad():
            for name, value in kept.items():
                model.canonical[name].copy_(value)
    covered = np.isfinite(wanted)
    assert covered.mean() > 0.5
    np.testing.assert_allclose(through[covered], wanted[covered], atol=1e-3)
    assert np.nanmax(np.abs(through - before)[covered]) > 0.05
    np.testing.assert_allclose(through[~covered], before[~covered], atol=1e-3)
    np.testing.assert_allclose(nothing_lasts, before, atol=1e-3)


def test_one_pass_draws_what_single_passes_draw(fresh):
    together = fresh.render(5, what=CHANNELS)
    assert set(together) == set(CHANNELS)
    shapes = {"rgb": (48, 64, 3), "depth": (48, 64), "displacement": (48, 64), "motion": (48, 64, 2), "alpha": (48, 64)}
    shapes |= {"observability": (48, 64), "uncertainty": (48, 64), "before": (48, 64, 3)}
    shapes["latent"] = (48, 64, fresh.basis.rank)
    for name in CHANNELS:
        alone = fresh.renderer.draw(5, fresh.camera(5), (name,))[name]
        assert alone.shape == together[name].shape == shapes[name]
        assert alone.dtype == np.float32
        np.testing.assert_allclose(alone, together[name], atol=1e-4)
    with pytest.raises(ValueError, match="'heat'"):
        fresh.render(5, what=("rgb", "heat"))


def test_channels_agree_with_the_rasterizer(fresh):
    camera, splats = fresh.camera(5), fresh.splats(5)
    z = splats.means[:, 2:]  # the camera stands at the origin
    places = (fresh.states.advected_means(5), fresh.states.advected_means(fresh.reference_frame))
    pixels = [torch.from_numpy(camera.project(m.numpy().astype(np.float64))[0]).float() for m in places]
    drawn = Render(*rasterize_reference(splats, torch.cat([splats.colors, z, pixels[1] - pixels[0]], 1), camera, None, None))
    image, alpha = drawn.image.numpy(), drawn.alpha.numpy()
    ours = fresh.render(5, what=CHANNELS)
    sure = alpha > 0.55
    assert sure.mean() > 0.95
    np.testing.assert_allclose(ours["rgb"], image[..., :3].clip(0, 1), atol=5e-3)
    np.testing.assert_allclose(ours["depth"][sure], (image[..., 3] / alpha)[sure], rtol=5e-3)
    np.testing.assert_allclose(ours["motion"][sure], (image[..., 4:] / alpha[..., None])[sure], atol=0.05)


def test_motion_leads_back_to_the_reference_frame(fresh):
    assert np.nanmax(np.abs(fresh.render(fresh.reference_frame, what=("motion",))["motion"])) == 0
    motion = fresh.render(8, what=("motion",))["motion"]
    assert np.isfinite(motion).mean() > 0.9
    assert np.nanmax(np.linalg.norm(motion, axis=-1)) > 0.3
    # A displacement d at depth z moves a Gaussian that was in view by no more than 1.5 · f · d / z: this camera sees less than 45° aside.
    camera, start = fresh.camera(0), fresh.states.advected_means(fresh.reference_frame).numpy()
    seen, before = camera.project(start)
    z = camera.project(fresh.states.advected_means(8).numpy())[1]
    inside = (np.abs(seen - (camera.cx, camera.cy)) < (camera.cx, camera.cy)).all(1) & (z > 0) & (before > 0)
    sideways = np.linalg.norm(fresh.states.screen_motion(8, camera, camera).numpy(), axis=1)
    bound = 1.5 * camera.fx * fresh.states.displacement(8).numpy() / z
    assert inside.sum() > 100
    assert (sideways - bound)[inside].max() < 1e-3


def test_motion_of_a_moving_camera_is_measured_from_the_cameras_of_both_frames(fresh):
    cameras = [dataclasses.replace(camera, viewmat=camera.viewmat.copy()) for camera in fresh.cameras]
    for index, camera in enumerate(cameras):
        camera.viewmat[0, 3] = 2.0 * index
    fresh.cameras = cameras
    frame, start = 4, fresh.reference_frame
    motion = fresh.renderer.draw(frame, fresh.camera(frame), ("motion",))["motion"]
    points = [fresh.splats(i).means.numpy().astype(np.float64) for i in (frame, start)]
    expected = cameras[start].project(points[1])[0] - cameras[frame].project(points[0])[0]
    assert np.nanmedian(motion[..., 0]) == pytest.approx(np.median(expected[:, 0]), abs=0.5)
    # seen by a camera of the user's, which does not move, only the tissue's own motion is left
    still = fresh.renderer.draw(frame, cameras[frame].scaled(1.0), ("motion",))["motion"]
    assert abs(np.nanmedian(still[..., 0])) < 0.3 * abs(np.nanmedian(motion[..., 0]))


def test_pictures_of_the_surgeons_view_are_kept_and_others_are_not(fresh):
    assert fresh.render(3) is fresh.render(3)
    assert fresh.render(3) is not fresh.render(4)
    camera = fresh.camera(3).scaled(0.5)
    assert fresh.render(3, camera) is not fresh.render(3, camera)
    assert fresh.render(3, camera)["rgb"].shape == (24, 32, 3)
    assert fresh.query(3) is fresh.query(3)
    assert fresh.query(3, camera) is not fresh.query(3, camera)
    picture = fresh.render_rgb(3)
    assert picture.dtype == np.uint8
    assert fresh.render_rgb(3) is picture
    assert fresh.renderer._cache.size == sum(v.nbytes for v in fresh.render(3).values()) + fresh.render(4)["rgb"].nbytes + picture.nbytes
    assert np.abs(picture / 255 - fresh.render(3)["rgb"]).max() <= 0.5 / 255 + 1e-6


def test_what_is_kept_of_frames_is_bounded(fresh, monkeypatch):
    """Semantics of frames do not push out drawn frames; Gaussians with latents take the place of those without."""
    monkeypatch.setattr("degense.engine.scene.renderer.QUERY_BYTES", 1)
    fresh.renderer.forget()
    drawn = fresh.render(3)
    first = fresh.query(3)
    fresh.query(4)
    assert fresh.query(3) is not first
    assert fresh.render(3) is drawn
    without = fresh.splats(5)
    assert fresh.splats(5) is without
    held = fresh.states._cache.size
    whole = fresh.splats(5, semantics=True)
    assert fresh.splats(5) is whole
    sizes = [sum(tensor.nbytes for tensor in vars(splats).values()) for splats in (without, whole)]
    assert fresh.states._cache.size - held == sizes[1] - sizes[0] > 0


@pytest.mark.parametrize("seed", [0, 1])
def test_a_cache_holds_the_latest_within_its_bytes(seed):
    random = np.random.default_rng(seed)
    cache, order, sizes, made = Latest(100), [], {}, []

    def make(key):
        made.append(key)
        return key

    for _ in range(300):
        key = int(random.integers(12))
        size = sizes.setdefault(key, int(random.integers(1, 60)))
        known, before = key in order, len(made)
        assert cache.get(key, lambda key=key: make(key), lambda _, size=size: size) == key
        assert (len(made) > before) == (not known)
        if known:
            order.remove(key)
        order.append(key)
        while sum(sizes[k] for k in order) > 100 and len(order) > 1:
            order.pop(0)
        assert list(cache._held) == order
        assert cache.size == sum(sizes[k] for k in order)


def test_the_newest_value_is_kept_even_when_it_is_too_large():
    cache = Latest(10)
    cache.get("a", lambda: 1, lambda _: 5)
    cache.get("b", lambda: 2, lambda _: 50)
    assert list(cache._held) == ["b"]


def test_room_is_made_before_a_value_is_made():
    cache = Latest(10)
    cache.get("a", lambda: 1, lambda _: 4)
    cache.get("b", lambda: 2, lambda _: 4)
    cache.make_room(5)
    assert list(cache._held) == ["b"]
    cache.make_room(50)
    assert (list(cache._held), cache.size) == ([], 0)


def test_prompts_need_semantics_and_known_words(scene, speechless):
    vectors = scene.vectors(("liver", "gallbladder"))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    with pytest.raises(PromptError):
        scene.vectors(("xyzzyqq",))
    for ask in (
        lambda: speechless.vectors(("liver",)),
        lambda: speechless.included("liver"),
        lambda: speechless.query(0),
        lambda: speechless.render(0, what=("latent",)),
    ):
        with pytest.raises(DegenseError, match=r"^speechless was trained without semantics") as caught:
            ask()
        assert "\n" not in str(caught.value)
    assert speechless.render(0)["rgb"].shape == (48, 64, 3)


def test_a_camera_behind_the_scene_sees_nothing(scene):
    viewmat = np.diag([1.0, 1.0, -1.0, 1.0])
    viewmat[:3, 3] = [0, 0, -1e4]
    drawn = scene.render(3, Camera(20, 15, 20.0, 20.0, 10.0, 7.5, viewmat), ("alpha", "rgb", "depth", "latent"))
    assert (drawn["alpha"] == 0).all()
    assert (drawn["rgb"] == 0).all()
    assert (drawn["latent"] == 0).all()
    assert np.isnan(drawn["depth"]).all()
