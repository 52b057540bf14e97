"""Task: scrub and play. Both views show the same instant, the last one that was asked for."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from PySide6.QtCore import Qt

from degense.widgets.qt_images import to_array
from tests.app import installed as on


def test_scrubbing_shows_the_last_frame_in_both_views(opened, idle, screenshot):
    session = opened.session
    shown: list[int] = []
    on.viewer(opened).shown.connect(lambda view: shown.append(view.frame))
    for frame in (3, 9, 1, 8, 2, 7):
        on.time(opened).timeline.frame_changed.emit(frame)
    idle()
    assert shown[-1] == session.frame == on.time(opened).timeline.frame() == 7
    assert len(shown) <= 3  # the frames in between were not drawn
    assert np.array_equal(on.viewer(opened).panel.grab_image(), session.scene.render_rgb(7))
    assert np.allclose(on.viewer(opened).view.splats.means, session.scene.splats(7).means)
    screenshot(opened, "scrub")
    canvas = on.viewer(opened).splats.focusProxy()
    idle()
    there = to_array(canvas.pixmap().toImage())
    assert there.shape == (canvas.height(), canvas.width(), 3)  # finely drawn in the end
    drawn = session.scene.renderer.draw(7, session.scene.camera(7).letterboxed(canvas.width(), canvas.height()), ("rgb", "alpha"))
    covered = drawn["alpha"] > 0.99
    assert np.abs(there[covered] / 255 - drawn["rgb"][covered]).max() < 0.03


def test_the_picture_is_painted_before_anything_else_is_asked_for(opened, idle, monkeypatch):
    """The answer first: the 3D view, the areas of masks and all that follows from it wait until it is on the screen."""
    panel, service, order = on.viewer(opened).panel, opened.worker, []
    submit, paint = service.submit, panel._paint
    monkeypatch.setattr(service, "submit", lambda channel, *rest, **named: (order.append(channel), submit(channel, *rest, **named)))
    monkeypatch.setattr(
        panel, "_paint", lambda painter: (order.append((on.viewer(opened).view.frame, on.viewer(opened).view.complete)), paint(painter))
    )
    opened.session.view.add_prompt("liver")
    idle()
    order.clear()
    opened.session.go_to(5)
    idle()
    assert order[0] == "view"
    answered = order.index((5.0, True))
    assert "snapshot" in order
    assert "answers" in order[answered:]
    assert not {"answers", "probe", "areas"} & set(map(str, order[:answered]))
    order.clear()
    opened.session.view.set_threshold(0.4)  # the same frame with other masks: the 3D view waits for them too
    idle()
    assert {"snapshot", "answers"} <= set(order[order.index((5.0, True)) :])
    assert not {"snapshot", "answers"} & set(map(str, order[: order.index((5.0, True))]))


@pytest.mark.parametrize(
    ("key", "modifier", "frame"),
    [
        (Qt.Key.Key_Right, Qt.KeyboardModifier.NoModifier, 5),
        (Qt.Key.Key_Left, Qt.KeyboardModifier.NoModifier, 3),
        (Qt.Key.Key_Left, Qt.KeyboardModifier.ShiftModifier, 0),
        (Qt.Key.Key_Right, Qt.KeyboardModifier.ShiftModifier, 9),
        (Qt.Key.Key_Home, Qt.KeyboardModifier.NoModifier, 0),
        (Qt.Key.Key_End, Qt.KeyboardModifier.NoModifier, 9),
    ],
)
def test_keys_move_time(qtbot, opened, idle, key, modifier, frame):
    on.viewer(opened).panel.setFocus()
    opened.session.go_to(4)
    idle()
    qtbot.keyClick(on.viewer(opened).panel, key, modifier)
    assert opened.session.frame == frame
    idle()


def test_space_plays_and_pauses(qtbot, opened, idle):
    on.viewer(opened).panel.setFocus()
    seen: set[int] = set()
    opened.session.frame_changed.connect(seen.add)
    qtbot.keyClick(on.viewer(opened).panel, Qt.Key.Key_Space)
    assert opened.session.playing
    assert on.time(opened).timeline.is_playing()
    qtbot.waitUntil(lambda: len(seen) >= 4)
    qtbot.keyClick(on.viewer(opened).panel, Qt.Key.Key_Space)
    assert not opened.session.playing
    assert not on.time(opened).timeline.is_playing()
    idle()
    assert on.viewer(opened).view.frame == opened.session.frame


def test_the_surgeons_camera_and_free_look(opened, idle):
    session, splats = opened.session, on.viewer(opened).splats
    idle()
    assert splats.camera.is_locked()
    opened.registry.run("camera.free")
    assert not splats.camera.is_locked()
    free = splats.camera.current()
    session.go_to(5)
    idle()
    assert np.array_equal(splats.camera.current().viewmat, free.viewmat)  # time moves, the free camera does not
    opened.registry.run("camera.free")
    assert splats.camera.is_locked()
    assert splats.camera.current() is session.scene.camera(5)


def test_the_window_stays_alive_while_frames_are_drawn(qtbot, opened, idle, monkeypatch):
    """A frame is drawn by the worker; until it is done the event loop turns."""
    import degense.app.features.viewer.controller as drawing

    real, begun, go_on = drawing.draw_shown, threading.Event(), threading.Event()

    def held(scene, request):
        begun.set()
        assert go_on.wait(30)  # in vain, if the window itself were drawing
        return (yield from real(scene, request))

    monkeypatch.setattr(drawing, "draw_shown", held)
    opened.session.go_to(6)
    qtbot.waitUntil(begun.is_set)
    qtbot.wait(50)
    assert on.viewer(opened).view.frame != 6
    go_on.set()
    idle()
    assert on.viewer(opened).view.frame == 6
