"""The 3D view with real events on a real (software) OpenGL window."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QColor, QMouseEvent, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QVBoxLayout, QWidget

from degense.widgets.qt_images import to_array
from degense.widgets.splats.camera_moves import letterboxed
from degense.widgets.splats.splat_view import SplatView
from tests.widgets.splatting import psnr, splatted

LEFT, NONE, SHIFT = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.ShiftModifier


@pytest.fixture
def background(monkeypatch):
    """Gives the 3D view a background of another colour than the theme's."""
    return lambda *rgb: monkeypatch.setattr("degense.widgets.splats.splat_view.frame_background", lambda palette: QColor(*rgb))


@pytest.fixture
def view(show, splats, camera, background):
    background(0, 0, 0)
    view = show(SplatView(), 192, 160)
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
    # On a screen twice as fine the clip's dilation is four times as many pixels.
    truth = splatted(splats, letterboxed(camera, 192, 160), dilation=0.3 * 4)
    tag = np.s_[:40, :150]
    truth[tag] = picture[tag] / 255
    assert psnr(picture, truth) > 45


def test_a_drag_leaves_the_lock_and_reset_returns(view, camera):
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
    QTest.keyClick(view.focusProxy(), Qt.Key.Key_R)
    assert view.camera.is_locked()
    assert locked == [False, True]
    assert view.camera.current() is camera
    np.testing.assert_array_equal(view.screenshot_image(), before)


def test_points_while_the_camera_moves_and_splats_when_it_rests(view, qtbot):
    drag(view, (60, 60), (70, 60))
    moving = view.grab().toImage()
    qtbot.waitUntil(lambda: view.grab().toImage() != moving)
    assert difference(view.screenshot_image(), view.screenshot_image()) == 0


def test_points_and_splats_share_nothing_that_one_could_spoil(view, qtbot, splats):
    for _ in range(2):
        QTest.keyClick(view.focusProxy(), Qt.Key.Key_Right)
        points = to_array(view.focusProxy().grabFramebuffer())
        truth = splatted(splats, view.camera.current())
        assert psnr(points, truth) < 45 / 2
        qtbot.waitUntil(lambda truth=truth: psnr(to_array(view.focusProxy().grabFramebuffer()), truth) > 45)


def test_snapshots_rendered_elsewhere(show, qtbot, splats, camera, background):
    """Each change requests a snapshot: coarse ones in quick succession, a fine one at last; it fills the view."""
    asked: list = []

    def drawn(request):
        return np.full((request.camera.height, request.camera.width, 3), request.background, np.uint8)

    background(10, 200, 30)
    view = show(SplatView(draw=drawn), 192, 160)

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
    QTest.keyClick(view.focusProxy(), Qt.Key.Key_Right)
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
    for key in (Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_Up, Qt.Key.Key_Down, Qt.Key.Key_Plus, Qt.Key.Key_Minus):
        QTest.keyClick(canvas, key)
    assert len(steps) == 8
    np.testing.assert_allclose(steps[-1], steps[1], atol=1e-9)  # the keys come in pairs that undo each other
    assert steps[1][2, 3] != steps[0][2, 3]


def test_a_click_picks_what_is_seen(view, qtbot, splats, camera):
    index = int(np.argmin(np.where(splats[3] > 0.8, camera.project(splats[0])[1], np.inf)))
    at = letterboxed(camera, 192, 160).project(splats[0][index])[0]
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
    scale = min(240 / camera.width, 200 / camera.height)
    truth = splatted(splats, letterboxed(camera, 240, 200), dilation=0.3 * scale**2)
    truth[:40, :150] = picture[:40, :150] / 255
    assert psnr(picture, truth) > 45


def test_without_a_camera_everything_is_framed(show, splats):
    view = show(SplatView(), 160, 120)
    view.set_splats(*splats)
    pixels, depth = view.camera.current().project(splats[0])
    assert not view.camera.is_locked()
    assert (depth > 0).all()
    assert ((pixels > 0) & (pixels < [160, 120])).all()
    view.close()


def test_background_follows_the_theme(show, qapp):
    from degense.widgets.theme import apply_theme

    view = show(SplatView(), 160, 120)
    brightness: list = []
    for name in ("dark", "light"):
        apply_theme(qapp, name)
        brightness.append(view.screenshot_image().mean())
    assert brightness[0] < 40
    assert brightness[1] > 180
    view.close()


def test_a_closed_view_is_gone(qtbot, splats, camera):
    window = QWidget()
    view = SplatView(window)
    QVBoxLayout(window).addWidget(view)
    with qtbot.waitExposed(window):
        window.show()
    view.camera.lock(camera)
    view.set_splats(*splats)
    view.screenshot_image()
    canvas = weakref.ref(view.focusProxy())
    renderer = weakref.ref(canvas().renderer)
    view.close()
    view.set_splats(*splats)  # a late frame harms nobody
    window.close()
    window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
    del view, window
    gc.collect()
    assert renderer() is None
    assert canvas() is None
