"""Cutting the 3D view open and moving its camera sideways, by keys that the window system sends, from anywhere in the window."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from degense.app.features.viewer.actions import SHIFT
from degense.widgets.qt_images import to_array
from degense.widgets.splats.gaussians import visible
from tests.app import installed as on

CONTROL = Qt.KeyboardModifier.ControlModifier
FAR = CONTROL | Qt.KeyboardModifier.ShiftModifier
UP, DOWN = Qt.Key.Key_PageUp, Qt.Key.Key_PageDown


def test_what_is_near_is_cut_away_and_comes_back(qtbot, opened, idle, screenshot):
    splats = on.viewer(opened).splats
    canvas = splats.focusProxy()
    on.viewer(opened).panel.setFocus()

    def press(key: Qt.Key, held: Qt.KeyboardModifier = CONTROL, times: int = 1) -> tuple[int, np.ndarray]:
        for _ in range(times):
            QTest.keyClick(opened.windowHandle(), key, held)
        return seen()

    def seen() -> tuple[int, np.ndarray]:
        idle()
        qtbot.waitUntil(lambda: canvas.pixmap().width() >= canvas.width())  # on a slow machine it is coarse at first
        return int(visible(splats.snapshot_request().gaussians).sum()), to_array(canvas.grab().toImage())

    whole, picture = seen()
    half, opened_up = press(DOWN, times=20)
    depths = splats.camera.viewport().project(splats.camera.means)[1]
    assert half == np.count_nonzero(depths >= splats.camera.viewport().project(splats.camera.pivot())[1])
    assert 0 < half < whole
    assert not np.array_equal(opened_up, picture)
    assert opened.session.camera_mode == "surgeon"  # the camera stays where it is
    screenshot(opened, "3d-cut-open")
    assert half < press(UP, times=2)[0] < whole
    count, same = press(UP, FAR)
    assert count == whole
    np.testing.assert_array_equal(same, picture)


def test_the_scene_is_moved_sideways(opened, idle, screenshot):
    splats = on.viewer(opened).splats
    on.viewer(opened).panel.setFocus()
    camera = splats.camera

    def middle() -> np.ndarray:
        return camera.viewport().project(camera.pivot())[0]

    at = middle()
    step = SHIFT * splats.devicePixelRatioF()
    for key, way in ((Qt.Key.Key_Right, (1, 0)), (Qt.Key.Key_Down, (0, 1)), (Qt.Key.Key_Left, (-1, 0)), (Qt.Key.Key_Up, (0, -1))):
        QTest.keyClick(opened.windowHandle(), key, FAR)
        assert opened.session.camera_mode == "free"
        assert np.allclose(middle() - at, np.multiply(way, step), atol=1e-6)
        at = middle()
    for _ in range(5):
        QTest.keyClick(opened.windowHandle(), Qt.Key.Key_Right, FAR)
    idle()
    screenshot(opened, "3d-moved")
    assert opened.session.frame == 0  # the arrows stepped no frames
    QTest.keyClick(opened.windowHandle(), Qt.Key.Key_V)
    assert opened.session.camera_mode == "surgeon"
    menu = opened.menus.menu(("View", "In 3D"))
    assert [action.text() for action in menu.actions()][:7] == [
        *("Cut away more of what is near", "Cut away less of what is near", "Cut nothing away"),
        *("Move the scene left", "Move the scene right", "Move the scene up", "Move the scene down"),
    ]
    assert opened.registry.search("clip plane")[0].id == "view3d.cut-more"
    assert opened.registry.search("pan")[0].id == "view3d.move-left"
