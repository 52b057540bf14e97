"""Points that are followed through a scene, against the field's own motion, its recording and exact tracks."""

import copy

import numpy as np
import pytest

from degense.engine.motion.matched import Matched
from degense.engine.scene.material import material_at, materials_at
from degense.engine.scene.tracks import contradicting, follow_points
from tests.motion.test_points import sliding


@pytest.fixture
def alone(scene):
    """The scene without its recording."""
    other = copy.copy(scene)
    other.clip = None
    return other


def test_many_points_have_the_material_of_one_at_a_time(scene):
    pixels = np.array([[20.5, 24.5], [40.2, 30.9], [5.0, 40.0], [-3.0, 8.0]])
    rows, weights, depth = materials_at(scene, 3, pixels)
    surface = scene.render(3, what=("depth",))["depth"]
    positions, z = scene.camera(3).project(scene.splats(3).means.numpy().astype(float))
    opacities = scene.splats(3).opacities.numpy()
    for k, (x, y) in enumerate(pixels[:3]):
        here = surface[int(y), int(x)]
        assert depth[k] == here
        away = np.hypot(*(positions - (x, y)).T)
        votes = np.where((away < 12) & (np.abs(z - here) < 0.1 * here) & (opacities > 0.01), opacities * np.exp(-(away**2) / 32), 0)
        expected = np.zeros(len(votes))
        best = np.argsort(votes)[-32:]
        expected[best] = votes[best] / votes[best].sum()
        found = np.zeros(len(votes))
        found[rows[k]] = weights[k]
        np.testing.assert_allclose(found, expected, atol=1e-5)
        alone = np.zeros(len(votes))
        indices, shares = material_at(scene, 3, x, y)
        alone[indices] = shares
        np.testing.assert_allclose(alone, expected, atol=1e-5)
    assert (weights[3] == 0).all()


def test_points_go_where_their_gaussians_go_both_ways(alone):
    scene = alone
    queries = np.array([[4, 20.5, 24.5], [0, 40.0, 30.0], [4, -9.0, 3.0]])
    found = follow_points(scene, queries)
    assert found.positions.shape == (3, scene.frames, 3)
    for k, (frame, x, y) in enumerate(queries[:2]):
        np.testing.assert_allclose(found.pixels[k, int(frame)], (x, y), atol=1e-6)
        indices, weights = material_at(scene, int(frame), x, y)
        if (scene.model.persistent.numpy()[indices]).all():
            for t in (0, scene.frames - 1):
                moved = (scene.splats(t).means - scene.splats(frame).means).numpy()[indices]
                expected = found.positions[k, int(frame)] + weights @ moved
                np.testing.assert_allclose(found.positions[k, t], expected, atol=1e-4)
        assert found.visible[k, int(frame)]
        for t in range(scene.frames):
            np.testing.assert_allclose(scene.camera(t).project(found.positions[k, t])[0], found.pixels[k, t])
    assert np.isnan(found.positions[2]).all()
    assert not found.visible[2].any()


def test_a_point_behind_a_surface_is_hidden(scene, monkeypatch):
    draw = scene.renderer.draw

    def nearer(frame, camera, what):
        drawn = draw(frame, camera, what)
        return drawn | {"depth": drawn["depth"] * (0.5 if frame == 2 else 1.0)}

    monkeypatch.setattr(scene.renderer, "draw", nearer)
    visible = follow_points(scene, np.array([[0, 20.5, 24.5]])).visible[0]
    assert visible[0]
    assert not visible[2]


def test_material_that_fades_is_replaced(alone, monkeypatch):
    """An instrument's Gaussians last for some frames: its point goes on with those that are there then."""
    from degense.engine.scene import material_tracks

    chosen = []
    monkeypatch.setattr(material_tracks, "LEFT", 1.5)  # as if all had faded at once
    monkeypatch.setattr(
        material_tracks, "materials_at", lambda scene, frame, pixels: chosen.append(frame) or materials_at(scene, frame, pixels)
    )
    found = follow_points(alone, np.array([[0, 20.5, 24.5]]))
    assert chosen == [*range(alone.frames - 1), 0]  # forwards at each frame, and once to go backwards
    assert np.isfinite(found.positions).all()
    still = follow_points(alone, np.array([[0, 20.5, 24.5]]))
    np.testing.assert_array_equal(found.positions, still.positions)


def recording(scene, frame_of):
    """The scene with another recording."""
    other = copy.copy(scene)
    other.clip = copy.copy(scene.clip)
    other.clip.frame = frame_of
    return other


def slid(frame: int) -> np.ndarray:
    """A texture that slides over the whole picture of the scene, 2 pixels to the right and 1 down a frame."""
    return np.ascontiguousarray(sliding(min(frame, 4))[8:56, 8:72])


def test_points_go_where_the_recording_clearly_shows_them(scene, alone):
    """The scene knows nothing of what this recording shows; what it moves by is far less."""
    assert scene.clip_size == (64, 48)
    query = np.array([[0, 26.5, 20.5]])
    found, without = follow_points(recording(scene, slid), query), follow_points(alone, query)
    for t in range(5):
        np.testing.assert_allclose(found.pixels[0, t], (26.5 + 2 * t, 20.5 + t), atol=0.5)
        surface = scene.renderer.draw(t, scene.camera(t), ("depth",))["depth"]
        x, y = np.floor(found.pixels[0, t]).astype(int)
        pixel, z = scene.camera(t).project(found.positions[:, t])
        np.testing.assert_allclose(pixel[0], found.pixels[0, t], atol=1e-6)
        np.testing.assert_allclose(z[0], surface[y, x], rtol=0.02)
    assert np.linalg.norm(without.pixels[0, 4] - found.pixels[0, 4]) > 5
    assert found.visible[0].all()


def test_a_recording_that_agrees_changes_nothing(scene, alone):
    query = np.array([[0, 20.5, 24.5], [4, 40.0, 30.0]])
    still = recording(scene, lambda frame: slid(0))
    near = follow_points(alone, query)
    moved = np.linalg.norm(near.pixels - query[:, None, 1:], axis=-1).max()
    found = follow_points(still, query)
    assert np.linalg.norm(found.pixels - query[:, None, 1:], axis=-1).max() <= moved + 1e-6


def test_a_point_that_the_recording_loses_to_another_thing_is_hidden(scene, alone):
    query = np.array([[0, 20.5, 24.5]])
    covered = recording(scene, lambda frame: slid(0) if frame < 3 else np.full((48, 64, 3), 255, np.uint8))
    found = follow_points(covered, query)
    assert follow_points(alone, query).visible.all()
    assert found.visible[0, :3].all()
    assert not found.visible[0, 3:].any()


def test_the_recording_contradicts_in_all_frames_that_it_follows_or_in_none():
    unlike = np.array([[0, 5, 5, 5, 5, np.nan], [0, 5, 5, 5, 5, np.nan], [0, np.nan, np.nan, np.nan, np.nan, np.nan]], np.float32)
    guessed = np.array([[0, 20, 20, 20, 5, 50], [0, 20, 6, 6, 6, 50], [0, 50, 50, 50, 50, 50]], np.float32)
    found = contradicting(Matched(np.zeros((3, 6, 2)), unlike, guessed))
    np.testing.assert_array_equal(found, [[True] * 5 + [False], [False] * 6, [False] * 6])


@pytest.mark.parametrize("frame", [0, 5])
def test_what_is_followed_stays_near_exact_tracks(scene, clip, frame):
    truth = clip.truth()
    y, x = np.mgrid[8:40:8, 8:56:8]
    queries = np.c_[np.full(x.size, frame), x.ravel() + 0.5, y.ravel() + 0.5]
    found = follow_points(scene, queries)
    assert np.isfinite(found.positions).all(-1).mean() > 0.9
    moved = np.linalg.norm(truth.displacement[frame], axis=-1)[y, x].ravel()
    known = np.isfinite(moved) & np.isfinite(found.positions[:, 0, 0])
    back = np.linalg.norm(found.positions[:, 0] - found.positions[:, frame], axis=-1)
    assert np.median(np.abs(back - moved)[known]) < 1.0  # mm; a training of some steps
