"""Points that are followed through a scene, against the field's own motion and against exact tracks."""

import numpy as np
import pytest

from degense.engine.scene.material import material_at, materials_at
from degense.engine.scene.tracks import follow_points


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


def test_points_go_where_their_gaussians_go_both_ways(scene):
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


def test_material_that_fades_is_replaced(scene, monkeypatch):
    """An instrument's Gaussians last for some frames: its point goes on with those that are there then."""
    from degense.engine.scene import tracks

    chosen = []
    monkeypatch.setattr(tracks, "LEFT", 1.5)  # as if all had faded at once
    monkeypatch.setattr(tracks, "materials_at", lambda scene, frame, pixels: chosen.append(frame) or materials_at(scene, frame, pixels))
    found = follow_points(scene, np.array([[0, 20.5, 24.5]]))
    assert chosen == [*range(scene.frames - 1), 0]  # forwards at each frame, and once to go backwards
    assert np.isfinite(found.positions).all()
    still = follow_points(scene, np.array([[0, 20.5, 24.5]]))
    np.testing.assert_array_equal(found.positions, still.positions)


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
