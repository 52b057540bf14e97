"""The 3D view with real events."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QColor, QMouseEvent, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from degense.app.features.viewer.view_rendering import draw_snapshot
from degense.widgets.splats import snapshot_surface
from degense.widgets.splats.gaussians import tamed
from degense.widgets.splats.guides import Guide, lay_over, projection_matrix
from degense.widgets.splats.splat_view import SplatView
from tests.widgets.splatting import psnr, splatted

LEFT, NONE, SHIFT = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ShiftModifier
CTRL = Qt.KeyboardModifier.ControlModifier


@pytest.fixture
def view(show, splats, camera):
    view = show(SplatView(draw_snapshot), 192, 160)
    view.snapshot_wanted.connect(lambda: view.show_snapshot(draw_snapshot(view.snapshot_request())))
    view.camera.lock(camera)
    view.set_splats(*splats)
    yield view
    view.close()


def drag(view, *stops, modifiers=NONE, button=LEFT):
    canvas = view.focusProxy()
    QTest.mousePress(canvas, button, modifiers, QPoint(*stops[0]))
    for stop in stops[1:]:
        at = QPointF(*stop)
        event = QMouseEvent(QEvent.Type.MouseMove, at, QPointF(canvas.mapToGlobal(at)), Qt.MouseButton.NoButton, button, modifiers)
        QApplication.sendEvent(canvas, event)
    QTest.mouseRelease(canvas, button, modifiers, QPoint(*stops[-1]))


def difference(a, b):
    return np.abs(a.astype(int) - b).mean()


def test_locked_view_is_the_2d_picture_enlarged(view, splats, camera):
    picture = view.screenshot_image()
    assert picture.shape == (160, 192, 3)
    truth = splatted(splats, camera.letterboxed(192, 160))
    tag = np.s_[:40, :150]
    truth[tag] = picture[tag] / 255
    assert psnr(picture, truth) > 45


def test_what_is_brighter_than_white_is_clipped_in_the_picture_only(view, splats, camera):
    """As in 2D: what lies behind a bright translucent Gaussian adds to it before the pixel is clipped."""
    *shapes, colours = splats
    colours = colours * 2.0 - 0.5
    view.set_splats(*shapes, colours)
    picture = view.screenshot_image()
    truth, clipped = (splatted((*shapes, c), camera.letterboxed(192, 160)).clip(0, 1) for c in (colours, colours.clip(0, 1)))
    tag = np.s_[:40, :150]
    truth[tag] = clipped[tag] = picture[tag] / 255
    assert psnr(picture, truth) > 45 > psnr(picture, clipped) + 10


def test_a_drag_leaves_the_lock(view, camera):
    moved: list = []
    locked: list = []
    view.camera.moved.connect(moved.append)
    view.camera.locked_changed.connect(locked.append)
    before = view.screenshot_image()
    assert view.camera.is_locked()
    drag(view, (60, 60), (80, 70), (120, 90))
    assert not view.camera.is_locked()
    assert locked == [False]
    assert len(moved) == 2
    np.testing.assert_array_equal(moved[-1].viewmat, view.camera.current().viewmat)
    assert not np.allclose(view.camera.current().viewmat, camera.viewmat)
    assert difference(view.screenshot_image(), before) > 2


def test_snapshots_that_take_long(show, qtbot, splats, camera, monkeypatch):
    """Each change requests a snapshot: coarse ones in quick succession, a fine one at last; it fills the view."""
    monkeypatch.setattr(snapshot_surface, "SLOW_MS", 0.0)
    asked: list = []

    def drawn(request):
        return np.full((request.camera.height, request.camera.width, 3), request.background, np.uint8)

    view = show(SplatView(drawn), 192, 160)
    view.set_background(QColor(10, 200, 30))

    def draw():
        asked.append(view.snapshot_request())
        view.show_snapshot(drawn(asked[-1]))

    view.snapshot_wanted.connect(draw)
    view.camera.lock(camera)
    assert not asked  # there is nothing to draw
    assert view.grab().toImage().pixelColor(96, 150).green() == 200
    view.set_splats(*splats)
    view.highlight(None)
    assert [request.camera.width for request in asked] == [192]
    QTest.keyClick(view.focusProxy(), Qt.Key.Key_Right, CTRL)
    assert asked[-1].camera.width == 96
    np.testing.assert_allclose(asked[-1].camera.viewmat, view.camera.current().viewmat)
    qtbot.waitUntil(lambda: asked[-1].camera.width == 192)
    assert view.screenshot_image().shape == (160, 192, 3)
    assert view.grab().toImage().pixelColor(96, 150).green() == 200
    drag(view, (60, 60), (80, 70), (120, 90))
    assert not view.camera.is_locked()
    view.close()
    count = len(asked)
    view.set_splats(*splats)  # a late frame harms nobody
    view.show_snapshot(drawn(asked[0]))
    assert len(asked) == count


def test_pan_wheel_and_keys_move_the_camera(view):
    steps: list = []
    view.camera.moved.connect(lambda camera: steps.append(camera.viewmat))
    drag(view, (60, 60), (80, 70), modifiers=SHIFT)
    np.testing.assert_allclose(steps[-1][:3, :3], view.camera.current().viewmat[:3, :3])
    canvas = view.focusProxy()
    at = QPointF(90, 70)
    wheel = QWheelEvent(at, at, QPoint(), QPoint(0, 120), Qt.MouseButton.NoButton, NONE, Qt.ScrollPhase.NoScrollPhase, False)
    QApplication.sendEvent(canvas, wheel)
    for key in (Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_Up, Qt.Key.Key_Down):
        QTest.keyClick(canvas, key, CTRL)
        QTest.keyClick(canvas, key)  # steps through time instead
    for key in (Qt.Key.Key_Plus, Qt.Key.Key_Minus):
        QTest.keyClick(canvas, key)
    assert len(steps) == 8
    np.testing.assert_allclose(steps[-1], steps[1], atol=1e-9)  # the keys come in pairs that undo each other
    assert steps[1][2, 3] != steps[0][2, 3]


def test_a_click_picks_what_is_seen(view, qtbot, splats, camera):
    index = int(np.argmin(np.where(splats[3] > 0.8, camera.project(splats[0])[1], np.inf)))
    at = camera.letterboxed(192, 160).project(splats[0][index])[0]
    with qtbot.waitSignal(view.picked) as heard:
        QTest.mouseClick(view.focusProxy(), LEFT, NONE, QPoint(round(at[0]), round(at[1])))
    chosen = heard.args[0]
    assert chosen == view.pick(round(at[0]), round(at[1])) >= 0
    assert view.camera.is_locked()
    view.set_splats(*(a[:0] for a in splats))
    assert view.pick(50, 50) == -1


def test_highlight_and_back(view, splats):
    plain = view.screenshot_image()
    view.highlight(np.arange(40))
    marked = view.screenshot_image()
    assert difference(marked, plain) > 1
    assert (marked.astype(int) @ [1, -2, 1]).mean() > (plain.astype(int) @ [1, -2, 1]).mean()  # more magenta
    view.highlight(None)
    np.testing.assert_array_equal(view.screenshot_image(), plain)


def test_a_highlight_survives_the_next_frame(view, splats):
    view.highlight(np.arange(40))
    marked = view.screenshot_image()
    view.set_splats(*splats)
    np.testing.assert_array_equal(view.screenshot_image(), marked)


def test_another_number_of_splats(view, splats, camera):
    whole = view.screenshot_image()
    view.highlight(np.arange(40))
    view.set_splats(*(a[:100] for a in splats))
    view.set_splats(*splats)
    np.testing.assert_array_equal(view.screenshot_image(), whole)


def test_resizing_keeps_the_lock(view, qtbot, splats, camera):
    view.resize(240, 200)
    qtbot.waitUntil(lambda: view.focusProxy().width() == 240)
    picture = view.screenshot_image()
    truth = splatted(splats, camera.letterboxed(240, 200))
    truth[:40, :150] = picture[:40, :150] / 255
    assert psnr(picture, truth) > 45


def test_without_a_camera_everything_is_framed(show, splats):
    view = show(SplatView(draw_snapshot), 160, 120)
    view.set_splats(*splats)
    pixels, depth = view.camera.current().project(splats[0])
    assert not view.camera.is_locked()
    assert (depth > 0).all()
    assert ((pixels > 0) & (pixels < [160, 120])).all()
    view.close()


def test_hostile_splats_harm_nobody_else(view, splats):
    truth = view.screenshot_image()
    rubbish = [np.concatenate([a, a[:6]]) for a in splats]
    rubbish[0][-6] = np.nan
    rubbish[2][-5] = np.inf
    rubbish[1][-4] = np.nan
    rubbish[3][-3] = np.nan
    rubbish[3][-2:] = 0.0
    view.set_splats(*rubbish)
    assert np.abs(view.screenshot_image().astype(int) - truth).max() <= 1


def test_what_is_not_there_is_not_drawn_even_when_marked(view, splats):
    means, quats, scales, opacities, colours = splats
    view.set_splats(means, quats, scales, np.where(np.arange(300) < 150, 0.0, opacities), colours)
    later = view.screenshot_image()
    view.highlight(np.arange(150))
    np.testing.assert_array_equal(view.screenshot_image(), later)
    assert psnr(later, splatted([a[150:] for a in splats], view.camera.viewport())) > 45


def test_what_is_near_is_cut_away(view, splats, camera):
    canvas, at = view.focusProxy(), QPointF(90, 70)
    for _ in range(20):
        wheel = QWheelEvent(at, at, QPoint(), QPoint(0, 120), Qt.MouseButton.NoButton, CTRL, Qt.ScrollPhase.NoScrollPhase, False)
        QApplication.sendEvent(canvas, wheel)
    assert view.camera.is_locked()
    depth = camera.project(splats[0])[1]
    behind = depth >= camera.project(np.median(splats[0], 0))[1]
    assert 50 < behind.sum() < 250
    assert psnr(view.screenshot_image(), splatted([a[behind] for a in splats], view.camera.viewport())) > 45


def test_guides_are_hidden_by_splats_before_them(show, camera):
    """One large opaque splat in the left half: a line through the picture is seen whole before it, and in the right half behind it."""
    view = show(SplatView(draw_snapshot), 192, 144)
    view.camera.lock(camera)
    wall = camera.unproject(np.array([[10.0, 36.0]]), np.array([4.0])), np.array([[1.0, 0, 0, 0]]), np.full((1, 3), 0.4), np.array([1.0])
    view.set_splats(*wall, np.array([[0.2, 0.2, 0.9]]))
    bare = view.screenshot_image()
    for depth, seen in ((2.0, True), (6.0, False)):
        ends = camera.unproject(np.array([[8.0, 36.0], [88.0, 36.0]]), np.full(2, depth))
        view.set_guides([Guide(ends, (255, 255, 0))])
        image = view.screenshot_image()
        yellow = (image[70:75] == [255, 255, 0]).all(-1).any(0)
        assert yellow[24] == seen
        assert yellow[120:170].all()
        assert not yellow[:12].any()
        assert not yellow[180:].any()
    view.set_guides([])
    np.testing.assert_array_equal(view.screenshot_image(), bare)


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
    np.testing.assert_allclose(camera.letterboxed(*size).project(points)[0], camera.project(points)[0] * scale + margin, atol=1e-9)


def test_colours_become_floats_and_are_not_clipped():
    one = np.zeros((1, 3)), np.ones((1, 4)), np.ones((1, 3)), np.ones(1)
    assert tamed(*one, np.array([[-1.0, 0.5, 2.0]])).colours.tolist() == [[-1.0, 0.5, 2.0]]
    assert tamed(*one, np.array([[0, 51, 255]], np.uint8)).colours.tolist() == [[0.0, np.float32(0.2), 1.0]]
    strange = tamed(*one, np.array([[0.1, np.nan, 0.3]]))
    assert strange.colours.tolist() == [[0.0, 0.0, 0.0]]
    assert strange.opacities.tolist() == [0.0]


def test_lines_and_names_are_no_larger_in_a_picture_that_is_stretched(qapp, camera):
    """A picture of half the size has lines of half the width, so that they keep theirs on the screen."""
    ends = camera.unproject(np.array([[0.2, 0.5], [0.6, 0.5]]) * [camera.width, camera.height], np.full(2, 4.0))
    small, ink = camera.letterboxed(camera.width // 2, camera.height // 2), []
    for seen, stretch in ((camera, 1.0), (small, 2.0)):
        black, nothing = np.zeros((seen.height, seen.width, 3), np.uint8), np.full((seen.height, seen.width), np.inf)
        plain, named = (lay_over(black, nothing, [Guide(ends, (255, 255, 255), text)], seen, stretch) for text in ("", "name"))
        ink.append((plain[:, seen.width // 3, 0].sum() / 255, named.sum() / 255 - plain.sum() / 255))
    (line, name), (small_line, small_name) = ink
    assert line == pytest.approx(2, abs=0.5)
    assert small_line == pytest.approx(line / 2, abs=0.5)
    assert small_name == pytest.approx(name / 4, rel=0.4)
