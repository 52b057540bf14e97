"""The joint fit against cameras and points written down, and its derivatives against differences."""

import numpy as np
from scipy.spatial.transform import Rotation

from degense.engine.camera import Camera
from degense.engine.data.poses.bundle import _moved, _residuals, _unproject, projected, refine
from degense.engine.data.poses.tracks import Track

CAMERA = Camera(160, 128, 130.0, 128.0, 81.0, 63.0)


def path(count: int, rng: np.random.Generator) -> np.ndarray:
    """A smooth path that starts at the identity."""
    phase = np.linspace(0, 2 * np.pi, count)
    views = np.tile(np.eye(4), (count, 1, 1))
    views[:, :3, :3] = Rotation.from_rotvec(np.sin(phase)[:, None] * rng.normal(0, 0.05, 3)).as_matrix()
    views[:, :3, 3] = (1 - np.cos(phase))[:, None] * rng.normal(0, 0.05, 3)
    return views


def track(key: int, frame: int, views: np.ndarray, rng: np.random.Generator, points: int = 150) -> Track:
    pixels = rng.uniform((0, 0), (160, 128), (points, 2))
    depth = rng.uniform(0.8, 1.3, points)
    rays = np.concatenate([(pixels - (81, 63)) / (130, 128), np.ones((points, 1))], 1) * depth[:, None]
    seen = []
    for ray in rays:  # as the definitions say it: into the world, then into the other camera
        world = np.linalg.inv(views[key]) @ [*ray, 1]
        x, y, z, _ = views[frame] @ world
        seen.append([130 * x / z + 81, 128 * y / z + 63])
    return Track(key, frame, np.arange(points), pixels, depth, np.array(seen))


def test_exact_tracks_give_exact_poses_although_a_third_goes_elsewhere():
    rng = np.random.default_rng(0)
    views = path(9, rng)
    tracks = [track(0, i, views, rng) for i in range(1, 6)] + [track(5, i, views, rng) for i in range(6, 9)]
    for t in tracks:
        t.seen[:50] += rng.uniform(5, 12, 2) + rng.normal(0, 1, (50, 2))
    found = refine(np.tile(np.eye(4), (9, 1, 1)), tracks, CAMERA)
    np.testing.assert_allclose(found, views, atol=2e-4)
    np.testing.assert_allclose(projected(found, tracks[3], CAMERA)[50:], tracks[3].seen[50:], atol=0.03)


def test_a_frame_without_points_follows_its_neighbours():
    rng = np.random.default_rng(1)
    views = path(17, rng)
    tracks = [track(0, i, views, rng) for i in range(1, 17) if i != 7]
    found = refine(np.tile(np.eye(4), (17, 1, 1)), tracks, CAMERA)
    np.testing.assert_allclose(found[7], views[7], atol=2e-3)
    assert np.abs(views[7] - views[6]).max() > 5e-3


def test_derivatives():
    rng = np.random.default_rng(2)
    views = path(4, rng)
    views[1:, :3, 3] += 0.02
    t = track(1, 3, views, rng, 5)
    _, by_key, by_frame = _residuals(views, t, _unproject(t, CAMERA), CAMERA)
    for frame, derivative in ((1, by_key), (3, by_frame)):
        for k in range(6):
            step = np.zeros((4, 6))
            step[frame, k] = 1e-6
            ahead, behind = (_residuals(_moved(views, sign * step), t, _unproject(t, CAMERA), CAMERA)[0] for sign in (1, -1))
            np.testing.assert_allclose(derivative[..., k], (ahead - behind) / 2e-6, atol=1e-5)
