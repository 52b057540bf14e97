"""Moves of a camera keep what they promise to keep."""

from __future__ import annotations

import numpy as np
import pytest

from degense.widgets.splats.camera_moves import dolly, framing, orbit, pan, splat_at


@pytest.fixture
def pivot(camera):
    return camera.unproject(np.array([30.0, 50.0]), np.array(4.0))


def is_rigid(viewmat):
    return np.allclose(viewmat[:3, :3] @ viewmat[:3, :3].T, np.eye(3)) and np.isclose(np.linalg.det(viewmat[:3, :3]), 1)


def test_orbit_keeps_the_pivot_in_place(camera, pivot, rng):
    for _ in range(5):
        turned = orbit(camera, pivot, *rng.uniform(-2, 2, 2))
        pixel, depth = turned.project(pivot)
        np.testing.assert_allclose(pixel, [30, 50])
        assert depth == pytest.approx(4.0)
        assert is_rigid(turned.viewmat)
        assert not np.allclose(turned.viewmat, camera.viewmat)


def test_a_drag_to_the_right_moves_near_things_to_the_right(camera, pivot):
    nearer = pivot - camera.viewmat[2, :3]
    assert orbit(camera, pivot, 0.1, 0.0).project(nearer)[0][0] > camera.project(nearer)[0][0]
    assert orbit(camera, pivot, 0.0, 0.1).project(nearer)[0][1] > camera.project(nearer)[0][1]


def test_pan_moves_the_pivot_by_pixels(camera, pivot):
    np.testing.assert_allclose(pan(camera, pivot, 7.0, -3.0).project(pivot)[0], [37, 47])


def test_dolly_changes_depth_only(camera, pivot):
    near = dolly(camera, pivot, 0.5)
    assert near.project(pivot)[1] == pytest.approx(2.0)
    np.testing.assert_allclose(near.viewmat[:2], camera.viewmat[:2])


@pytest.mark.parametrize("size", [(640, 480), (200, 700)])
def test_framing_sees_everything(rng, size):
    points = rng.normal(size=(100, 3)) * [3, 1, 2] + 10
    pixels, depth = framing(points, *size).project(points)
    assert (depth > 0).all()
    assert ((pixels > 0) & (pixels < size)).all()
    assert framing(points[:0], *size).project(np.zeros(3))[1] > 0
    assert framing(points[:1], *size).project(points[0])[1] > 0


def test_picking_takes_the_greatest_share(camera, splats, rng):
    means, quats, scales, opacities, _ = splats
    from scipy.spatial.transform import Rotation

    eye = -camera.viewmat[:3, :3].T @ camera.viewmat[:3, 3]
    for x, y in rng.uniform(5, 60, (12, 2)):
        # The oracle walks along the ray instead of solving for the peak.
        steps = np.linspace(0.05, 12, 4000)
        ray = camera.unproject(np.array([x, y]), np.array(1.0)) - eye
        weight, passed = np.zeros(len(means)), 1.0
        for i in np.argsort(camera.project(means)[1]):
            offsets = (eye + steps[:, None] * ray - means[i]) @ Rotation.from_quat(quats[i], scalar_first=True).as_matrix() / scales[i]
            alpha = opacities[i] * np.exp(-0.5 * (offsets**2).sum(1).min())
            weight[i] = passed * alpha * (alpha >= 1 / 255)
            passed *= 1 - alpha * (alpha >= 1 / 255)
        found = splat_at(x, y, camera, means, quats, scales, opacities)
        assert weight[found] == pytest.approx(weight.max(), rel=1e-2)


def test_picking_nothing(camera, splats):
    means, quats, scales, opacities, _ = splats
    assert splat_at(10, 10, camera, means, quats, scales, np.zeros_like(opacities)) == -1
    assert splat_at(10, 10, camera, means[:0], quats[:0], scales[:0], opacities[:0]) == -1
    behind = camera.unproject(np.full((len(means), 2), 40.0), np.full(len(means), -3.0))
    assert splat_at(40, 40, camera, behind, quats, scales, opacities) == -1


@pytest.mark.parametrize("size", [(515, 794), (900, 300)])
def test_filled_undoes_letterboxed(camera, size):
    back = camera.letterboxed(*size).filled(camera.width, camera.height)
    assert (back.fx, back.fy, back.cx, back.cy) == pytest.approx((camera.fx, camera.fy, camera.cx, camera.cy))
