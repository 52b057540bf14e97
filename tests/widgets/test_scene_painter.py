"""VTK's splats against a slow splatter that is obviously right."""

from __future__ import annotations

import numpy as np
import pytest

from degense.widgets.splats.camera_moves import letterboxed
from degense.widgets.splats.gaussians import tamed
from degense.widgets.splats.scene_painter import projection_matrix
from tests.widgets.splatting import draw_offscreen, psnr, splatted


def test_matches_the_oracle(qapp, splats, camera):
    assert psnr(draw_offscreen(*splats, camera), splatted(splats, camera)) > 45


def test_order_of_the_input_does_not_matter(qapp, splats, camera, rng):
    order = rng.permutation(len(splats[0]))
    shuffled = draw_offscreen(*(a[order] for a in splats), camera)
    assert np.abs(shuffled.astype(int) - draw_offscreen(*splats, camera)).max() <= 1


def test_background_shows_through(qapp, splats, camera):
    faint = (*splats[:3], splats[3] * 0.3, splats[4])
    picture = draw_offscreen(*faint, camera, background=(200, 40, 90))
    assert psnr(picture, splatted(faint, camera, background=np.array([200, 40, 90]) / 255)) > 40


def test_hostile_splats_harm_nobody_else(qapp, splats, camera):
    truth = draw_offscreen(*splats, camera)
    rubbish = [np.concatenate([a, a[:6]]) for a in splats]
    rubbish[0][-6] = np.nan
    rubbish[2][-5] = np.inf
    rubbish[1][-4] = np.nan
    rubbish[3][-3] = np.nan
    rubbish[3][-2:] = 0.0
    assert np.abs(draw_offscreen(*rubbish, camera).astype(int) - truth).max() <= 1


def test_a_zero_quaternion_is_no_rotation(qapp, splats, camera):
    means, _, *rest = splats
    still = np.tile([1.0, 0, 0, 0], (len(means), 1))
    assert np.array_equal(draw_offscreen(means, still * 0, *rest, camera), draw_offscreen(means, still * 7, *rest, camera))


def test_nothing_to_draw(qapp, splats, camera):
    picture = draw_offscreen(*(a[:0] for a in splats), camera, background=(10, 20, 30))
    assert picture.shape == (camera.height, camera.width, 3)
    assert np.abs(picture.astype(int) - [10, 20, 30]).max() <= 1


def test_everything_behind_the_camera(qapp, splats, camera):
    behind = camera.unproject(np.full((len(splats[0]), 2), 40.0), np.full(len(splats[0]), -3.0))
    assert draw_offscreen(behind, *splats[1:], camera).max() == 0


def test_projection_agrees_with_the_camera(camera, rng):
    points = camera.unproject(rng.uniform(0, 90, (50, 2)), rng.uniform(1, 9, 50))
    local = points @ camera.viewmat[:3, :3].T + camera.viewmat[:3, 3]
    clip = np.column_stack([local * [1, -1, -1], np.ones(50)]) @ projection_matrix(camera, 0.5, 10.0).T
    ndc = clip[:, :3] / clip[:, 3:]
    pixels = (ndc[:, :2] * [1, -1] + 1) / 2 * [camera.width, camera.height]
    np.testing.assert_allclose(pixels, camera.project(points)[0], atol=1e-9)
    assert (np.abs(ndc[:, 2]) < 1).all()


@pytest.mark.parametrize("size", [(192, 144), (300, 144), (192, 400), (96, 72)])
def test_letterbox_keeps_the_picture_whole_and_centred(camera, size, rng):
    points = camera.unproject(rng.uniform(0, 72, (20, 2)), rng.uniform(1, 9, 20))
    scale = min(size[0] / camera.width, size[1] / camera.height)
    margin = (np.array(size) - scale * np.array([camera.width, camera.height])) / 2
    np.testing.assert_allclose(letterboxed(camera, *size).project(points)[0], camera.project(points)[0] * scale + margin, atol=1e-9)


def test_colours_become_bytes():
    one = np.zeros((1, 3)), np.ones((1, 4)), np.ones((1, 3)), np.ones(1)
    assert tamed(*one, np.array([[-1.0, 0.5, 2.0]])).colours.tolist() == [[0, 128, 255]]
    assert tamed(*one, np.array([[1, 2, 3]], np.uint8)).colours.tolist() == [[1, 2, 3]]
