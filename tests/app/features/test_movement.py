"""Task: play a part of the clip, keep cameras, fly along them, and take a movie of the flight."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QMouseEvent
from PySide6.QtWidgets import QApplication, QFileDialog, QPushButton

from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.cameras.state import CameraPath
from degense.app.features.movies.dialog import MovieDialog
from degense.app.features.movies.movie import MovieOptions
from degense.app.session.targets import Spot
from degense.widgets import forms
from degense.widgets.qt_images import to_array
from tests.app import installed as on


def press(qtbot, panel, text: str) -> None:
    button = next(button for button in panel.findChildren(QPushButton) if button.text().startswith(text))
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def test_a_part_is_played_over_and_over(qtbot, opened, idle, run, screenshot):
    session, panel, timeline = opened.session, on.viewer(opened).panel, on.time(opened).timeline
    panel.setFocus()
    session.go_to(3)
    qtbot.keyClick(panel, Qt.Key.Key_I)
    session.go_to(6)
    qtbot.keyClick(panel, Qt.Key.Key_O)
    idle()
    screenshot(opened, "movement-loop")
    seen: list[int] = []
    session.frame_changed.connect(seen.append)
    qtbot.keyClick(panel, Qt.Key.Key_Space)
    qtbot.waitUntil(lambda: seen.count(3) >= 2 and 6 in seen)
    rate = timeline._rate.text()
    assert rate.endswith("/ 25 fps")
    qtbot.keyClick(panel, Qt.Key.Key_Space)
    idle()
    assert set(seen) <= {3, 4, 5, 6}
    session.save()
    on.documents(opened).open_path(run)
    idle()
    assert timeline.played() == (3, 6)
    panel.setFocus()
    qtbot.keyClick(panel, Qt.Key.Key_I, Qt.KeyboardModifier.ShiftModifier)
    assert timeline.played() == (0, 9)


def test_cameras_are_kept_flown_and_filmed(qtbot, opened, idle, run, screenshot, tmp_path, monkeypatch):
    session, splats, listed = opened.session, on.viewer(opened).splats, on.cameras(opened).panel
    splats.setFocus()
    opened.registry.run("cameras.add")
    session.go_to(8)
    for _ in range(3):
        qtbot.keyClick(splats._canvas, Qt.Key.Key_Right, Qt.KeyboardModifier.ControlModifier)
    there = splats.camera.current()
    opened.registry.run("cameras.add")
    assert [row[:2] for row in forms.texts(listed.table)] == [("Camera 1", "0"), ("Camera 2", "8")]
    idle()
    listed.table.item(0, 2).setText("0.4")  # as typed into the cell
    assert on.cameras(opened).book.stops[0].seconds == 0.4
    listed.table.item(0, 2).setText("soon")
    assert forms.texts(listed.table)[0][2] == "0.4"
    screenshot(opened, "movement-cameras")
    opened.registry.run("cameras.previous")
    idle()
    assert session.frame == 0
    assert not np.allclose(splats.camera.current().viewmat, there.viewmat)
    press(qtbot, listed, "Fly")
    qtbot.waitUntil(lambda: on.cameras(opened)._flight is None)
    idle()
    assert session.frame == 8
    assert np.allclose(splats.camera.current().viewmat, there.viewmat, atol=1e-9)
    film = tmp_path / "flight.mp4"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *args: (str(film), ""))
    session.view.set_layer("displacement")
    press(qtbot, listed, "Movie")
    press(qtbot, opened.findChild(MovieDialog), "Save")
    idle()
    movie = cv2.VideoCapture(str(film))
    assert movie.get(cv2.CAP_PROP_FRAME_COUNT) == 11  # 0.4 s at 25 a second, both ends
    pictures = [movie.read()[1].astype(int) for _ in range(11)]
    movie.release()
    assert np.abs(pictures[0] - pictures[-1]).mean() > 5
    path = tmp_path / "path.json"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *args: (str(path), ""))
    opened.registry.run("cameras.save")
    stops = on.cameras(opened).book.stops
    on.cameras(opened).book.remove(0)
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *args: (str(path), ""))
    opened.registry.run("cameras.open")
    assert len(forms.texts(listed.table)) == 2
    assert np.allclose(CameraPath(on.cameras(opened).book.stops).at(0.2)[0].viewmat, CameraPath(stops).at(0.2)[0].viewmat)
    session.undo.undo()
    session.undo.undo()
    assert on.cameras(opened).book.stops == stops
    session.save()
    on.documents(opened).open_path(run)
    idle()
    assert [row[0] for row in forms.texts(listed.table)] == ["Camera 1", "Camera 2"]


def test_a_movie_is_stopped_and_leaves_nothing(qtbot, opened, idle, tmp_path):
    for frame in (0, 9):
        opened.session.go_to(frame)
        opened.registry.run("cameras.add")
    idle()
    on.cameras(opened).book.change(0, seconds=600.0)
    on.movies(opened).write(
        tmp_path / "long.mp4", MovieOptions(opened.session.view_state, stops=on.cameras(opened).book.stops), Anonymity()
    )
    qtbot.waitUntil(lambda: ": frame" in opened.status.busy_text.text())
    opened.registry.run("export.stop")
    idle()
    qtbot.waitUntil(lambda: list(tmp_path.glob("*long*")) == [])


def test_a_screenshot_of_the_3d_view(opened, idle, tmp_path):
    on.exporter(opened).save_screenshot(tmp_path / "a.png")
    shown = cv2.imread(str(tmp_path / "a.png"))[..., ::-1]
    assert shown.shape[1] == on.viewer(opened).splats.width()
    assert shown.std() > 10
    opened.session.view.set_layer("depth")
    idle()
    on.exporter(opened).save_screenshot(tmp_path / "b.png")
    assert cv2.imread(str(tmp_path / "b.png")).shape[1] > shown.shape[1]  # with its colour bar


@pytest.mark.parametrize("key", [Qt.Key.Key_Down, Qt.Key.Key_Up])
def test_no_cameras_no_harm(qtbot, opened, key):
    on.viewer(opened).panel.setFocus()
    qtbot.keyClick(on.viewer(opened).panel, key, Qt.KeyboardModifier.AltModifier)
    assert opened.session.frame == 0


def test_slow_pictures_of_the_3d_view_are_coarse_at_first(qtbot, opened, idle, monkeypatch):
    """Coarse pictures while the hand moves, then fine ones with every splat where it should be, turn after turn."""
    monkeypatch.setattr("degense.widgets.splats.snapshot_surface.SLOW_MS", 0.0)
    splats = on.viewer(opened).splats
    opened.session.go_to(8)
    idle()
    sizes: list[int] = []
    take = splats._canvas.take
    splats._canvas.take = lambda rgb: (sizes.append(rgb.shape[1]), take(rgb))
    for _ in range(2):
        sizes.clear()
        for _ in range(2):
            qtbot.keyClick(splats._canvas, Qt.Key.Key_Right, Qt.KeyboardModifier.ControlModifier)
            idle()
        qtbot.waitUntil(lambda: len(sizes) > 2 and sizes[-1] == splats._canvas.width())
        assert min(sizes) == splats._canvas.width() // 2
        shown = to_array(splats._canvas.pixmap().toImage())
        rendered = opened.session.scene.renderer.draw(8, splats.camera.current(), ("rgb", "alpha"))
        covered = rendered["alpha"] > 0.99
        assert np.abs(shown[covered] / 255 - rendered["rgb"][covered]).max() < 0.03


def test_keys_and_background_of_the_3d_view(qtbot, qapp, opened, idle, screenshot):
    """After a drag arrows still step through time, with Ctrl they turn, R starts a region, V goes back; the background is no theme's."""
    session, splats = opened.session, on.viewer(opened).splats
    canvas = splats.focusProxy()
    qtbot.mousePress(canvas, Qt.MouseButton.LeftButton, pos=QPoint(200, 200))
    qtbot.mouseMove(canvas, QPoint(230, 210))
    move = QMouseEvent(
        QEvent.Type.MouseMove,
        QPointF(260, 215),
        QPointF(canvas.mapToGlobal(QPoint(260, 215))),
        Qt.MouseButton.NoButton,
        Qt.MouseButton.LeftButton,
        Qt.KeyboardModifier.NoModifier,
    )
    QApplication.sendEvent(canvas, move)
    qtbot.mouseRelease(canvas, Qt.MouseButton.LeftButton, pos=QPoint(260, 215))
    assert session.camera_mode == "free"
    turned = splats.camera.current().viewmat
    for key, frame in ((Qt.Key.Key_Right, 1), (Qt.Key.Key_Right, 2), (Qt.Key.Key_Left, 1), (Qt.Key.Key_End, 9), (Qt.Key.Key_Home, 0)):
        qtbot.keyClick(canvas, key)
        assert session.frame == frame
    np.testing.assert_array_equal(splats.camera.current().viewmat, turned)
    qtbot.keyClick(canvas, Qt.Key.Key_Up, Qt.KeyboardModifier.ControlModifier)
    assert not np.allclose(splats.camera.current().viewmat, turned)
    qtbot.keyClick(canvas, Qt.Key.Key_R)
    assert on.probe(opened).has_tool("rectangle")
    assert session.camera_mode == "free"
    idle()
    for theme in ("light", "dark"):
        opened.registry.run(f"theme.{theme}")
        idle()
        screenshot(opened, f"3d-free-{theme}")
        corner = to_array(canvas.grab().toImage())[-4:, :4]
        assert corner.max() < 40
    on.preferences(opened).change("3D background", background="white")
    idle()
    assert to_array(canvas.grab().toImage())[-4:, :4].min() > 250
    session.undo.undo()
    qtbot.keyClick(canvas, Qt.Key.Key_V)
    assert session.camera_mode == "surgeon"


def test_cameras_trail_and_length_in_3d(qtbot, opened, idle, screenshot):
    """Guides in the view where truth says: the trail and the length start at the material that is followed."""
    session, viewer = opened.session, on.viewer(opened)
    splats, probe = viewer.splats, on.probe(opened)
    opened.registry.run("cameras.add")
    session.probe = Spot(0, 30.5, 40.5)
    idle()
    start = probe.curves.trail
    opened.registry.run("inspect.measure")
    session.probe = Spot(0, 70.5, 40.5)
    idle()
    for name in ("guides.trail", "guides.cameras", "guides.axes"):
        opened.registry.run(name)
    session.go_to(6)
    for _ in range(4):
        qtbot.keyClick(splats.focusProxy(), Qt.Key.Key_Right, Qt.KeyboardModifier.ControlModifier)
    idle()
    screenshot(opened, "3d-guides")
    lines = splats.snapshot_request().guides
    [length] = [line for line in lines if line.text.endswith(session.scene.unit) and line.text[0].isdigit()]
    ends = np.stack([start[6], probe.curves.trail[6]])
    np.testing.assert_allclose(length.points, ends)
    assert float(length.text.split()[0]) == pytest.approx(np.linalg.norm(ends[1] - ends[0]), rel=0.01)
    pixel, _ = session.scene.camera(0).project(start[0])
    assert np.abs(pixel - [30.5, 40.5]).max() < 8
    with_lines = splats.screenshot_image()
    splats.set_guides(())
    assert (with_lines != splats.screenshot_image()).any(-1).sum() > 300
    assert {line.text for line in lines} >= {"Camera 1", "surgeon", "x", "y", "z"}
