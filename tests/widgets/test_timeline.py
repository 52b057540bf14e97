"""Scrubbing and playing, with a clock of our own where time matters."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QColor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox, QLabel

from degense.widgets.frame_track import FrameTrack
from degense.widgets.glyphs import GlyphButton
from degense.widgets.timeline import PATIENCE, SPEEDS, Timeline, played_frame

NONE = Qt.KeyboardModifier.NoModifier


@pytest.fixture
def timeline(show):
    timeline = show(Timeline(), 620, 100)
    timeline.set_frames(40, fps=20.0)
    return timeline


@pytest.fixture
def heard(timeline):
    frames: list = []
    timeline.frame_changed.connect(frames.append)
    return frames


class Clock:
    """Time that passes when told; the timeline's own timer is stopped and its ticks are made by hand."""

    def __init__(self, timeline):
        self.now, self._timeline = 100.0, timeline
        timeline._clock = lambda: self.now

    def tick(self, seconds):
        self.now += seconds
        self._timeline._tick()


@pytest.fixture
def clock(timeline):
    return Clock(timeline)


def play(timeline):
    timeline.play()
    timeline._tick_timer.stop()


def track(timeline):
    return timeline.findChild(FrameTrack)


def button(timeline, name):
    return next(b for b in timeline.findChildren(GlyphButton) if b.accessibleName() == name)


def readout(timeline, name="Frame and time"):
    return next(label.text() for label in timeline.findChildren(QLabel) if label.accessibleName() == name)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [("once", [0, 1, 2, 3, 3, 3, 3, 3, 3]), ("loop", [0, 1, 2, 3, 0, 1, 2, 3, 0]), ("bounce", [0, 1, 2, 3, 2, 1, 0, 1, 2])],
)
def test_order_of_frames(mode, expected):
    assert [played_frame(phase + 0.5, 4, mode)[0] for phase in range(9)] == expected
    assert [played_frame(phase, 4, mode)[1] for phase in range(5)] == [mode == "once" and phase >= 3 for phase in range(5)]


def test_setting_is_silent_and_clipped(timeline, heard, qtbot):
    timeline.set_frame(12)
    assert timeline.frame() == 12
    assert readout(timeline) == "Frame 12 / 39    0.60 / 1.95 s"
    timeline.set_frame(400)
    assert timeline.frame() == 39
    qtbot.wait(20)
    assert heard == []


def test_scrubbing_tells_the_latest_only(timeline, heard, qtbot):
    bar = track(timeline)
    QTest.mousePress(bar, Qt.MouseButton.LeftButton, NONE, QPoint(10, bar.height() - 15))
    for x in range(20, bar.width() - 9, 7):
        bar.setValue(bar._frame_at(x))
    bar.setValue(39)
    QTest.mouseRelease(bar, Qt.MouseButton.LeftButton, NONE, QPoint(bar.width() - 10, 5))
    assert timeline.frame() == 39
    qtbot.waitUntil(lambda: bool(heard))
    qtbot.wait(20)
    assert heard == [39]


def test_pressing_the_line_goes_there(timeline, heard, qtbot):
    bar = track(timeline)
    QTest.mouseClick(bar, Qt.MouseButton.LeftButton, NONE, QPoint(bar.width() // 2, bar.height() // 2))
    qtbot.waitUntil(lambda: heard in ([19], [20]))


def test_keys_on_the_line(timeline, heard, qtbot):
    bar = track(timeline)
    bar.setFocus()
    steps = [(Qt.Key.Key_Right, NONE, 1), (Qt.Key.Key_Right, Qt.KeyboardModifier.ShiftModifier, 11), (Qt.Key.Key_Left, NONE, 10)]
    steps += [(Qt.Key.Key_End, NONE, 39), (Qt.Key.Key_PageUp, NONE, 29), (Qt.Key.Key_PageDown, NONE, 39), (Qt.Key.Key_Home, NONE, 0)]
    for key, modifier, frame in steps:
        QTest.keyClick(bar, key, modifier)
        assert timeline.frame() == frame
    QTest.keyClick(bar, Qt.Key.Key_Space)
    assert timeline.is_playing()
    timeline.pause()


def test_buttons(timeline, heard, qtbot):
    for name, frame in (("Next frame", 1), ("Last frame", 39), ("Previous frame", 38), ("First frame", 0)):
        QTest.mouseClick(button(timeline, name), Qt.MouseButton.LeftButton)
        qtbot.waitUntil(lambda frame=frame: heard[-1:] == [frame])
    playing: list = []
    timeline.playing_changed.connect(playing.append)
    QTest.mouseClick(button(timeline, "Play"), Qt.MouseButton.LeftButton)
    QTest.mouseClick(button(timeline, "Pause"), Qt.MouseButton.LeftButton)
    assert playing == [True, False]


def test_playback_keeps_real_time_by_dropping_frames(timeline, heard, clock):
    play(timeline)
    for _ in range(10):  # each drawing takes 0.2 s, four frames
        clock.tick(0.2)
        timeline.frame_drawn()
    assert heard == [4, 8, 12, 16, 20, 24, 28, 32, 36, 0]
    assert readout(timeline, "Frames a second, reached and wanted") == "5 / 20 fps"
    timeline.pause()


def test_playback_waits_for_the_drawing_but_not_for_ever(timeline, heard, clock):
    play(timeline)
    clock.tick(0.06)
    assert heard == [1]
    for _ in range(5):
        clock.tick(0.05)
    assert heard == [1]
    clock.tick(PATIENCE)
    assert len(heard) == 2
    timeline.pause()


def test_once_stops_at_the_end_and_starts_again(timeline, heard, clock):
    timeline.set_loop_mode("once")
    timeline.set_frame(37)
    playing: list = []
    timeline.playing_changed.connect(playing.append)
    play(timeline)
    for _ in range(4):
        clock.tick(0.05)
        timeline.frame_drawn()
    assert timeline.frame() == 39
    assert playing == [True, False]
    play(timeline)
    assert timeline.frame() == 0
    timeline.pause()


@pytest.mark.parametrize("speed", SPEEDS)
def test_speed(timeline, clock, speed):
    timeline.set_speed(speed)
    play(timeline)
    clock.tick(0.401)
    assert timeline.frame() == int(0.401 * 20 * speed)
    timeline.pause()


def test_scrubbing_while_playing_goes_on_from_there(timeline, clock, heard):
    play(timeline)
    clock.tick(0.1)
    timeline.frame_drawn()
    track(timeline).setValue(30)
    clock.tick(0.11)
    assert timeline.frame() == 32
    assert timeline.is_playing()
    timeline.step(1)
    assert timeline.frame() == 33
    assert not timeline.is_playing()


def test_real_playback_advances(timeline, heard, qtbot):
    timeline.frame_changed.connect(lambda _: timeline.frame_drawn())
    timeline.play()
    qtbot.waitUntil(lambda: len(heard) >= 4)
    timeline.pause()
    count = len(heard)
    qtbot.wait(80)
    assert len(heard) == count


def test_choices_are_told_when_the_user_makes_them(timeline, qtbot):
    speeds: list = []
    modes: list = []
    timeline.speed_changed.connect(speeds.append)
    timeline.loop_mode_changed.connect(modes.append)
    timeline.set_speed(4.0)
    timeline.set_loop_mode("bounce")
    assert (speeds, modes) == ([], [])
    boxes = {box.accessibleName(): box for box in timeline.findChildren(QComboBox)}
    QTest.keyClick(boxes["Playback speed"], Qt.Key.Key_Up)
    QTest.keyClick(boxes["At the end"], Qt.Key.Key_Up)
    assert (speeds, modes) == ([2.0], ["loop"])


def test_marks_and_strips_are_painted(timeline):
    bar = track(timeline)
    low, plain = bar.height(), timeline.grab().toImage()
    bar.set_marks(test=[1, 9, 17], labelled={"painted": [0, 20], "doubtful": [3]})
    marked = timeline.grab().toImage()
    assert marked != plain
    values = np.linspace(0, 5, 40)
    values[10:14] = np.nan
    bar.set_strips({"liver": (values, QColor("#e69f00"))})
    assert bar.sizeHint().height() > low - 5
    assert timeline.grab().toImage() != marked
    bar.set_strips({"nothing": (np.full(40, np.nan), QColor("red"))})
    timeline.grab()
    with pytest.raises(ValueError, match="3 values for 40 frames"):
        bar.set_strips({"liver": (np.zeros(3), QColor("red"))})
    bar.set_strips({})


def test_what_has_no_room_is_left_out_whole(timeline, qapp):
    """The time first; a number is never cut in two."""
    timeline.set_frames(24)
    words = next(label for label in timeline.findChildren(QLabel) if label.accessibleName() == "Frame and time")
    timeline.resize(900, 60)
    timeline.show()
    timeline.set_frame(14)
    assert "14 / 23" in words.text()
    assert "0.56 / 0.92 s" in words.text()
    full = words.text()
    timeline.resize(timeline._row.sizeHint().width() - 10, 60)
    qapp.processEvents()
    assert words.text() == "Frame 14 / 23"
    assert words.width() >= words.fontMetrics().horizontalAdvance(words.text())
    assert words.toolTip() == full
    assert timeline.minimumSizeHint().width() < timeline._row.sizeHint().width()  # it holds no window wide


def test_no_frames_and_one_frame(timeline, heard, qtbot):
    timeline.play()
    timeline.set_frames(0)
    assert not timeline.is_playing()
    assert readout(timeline) == "No frames"
    assert not button(timeline, "Play").isEnabled()
    timeline.set_frames(1)
    timeline.play()
    assert not timeline.is_playing()
    timeline.step(3)
    qtbot.wait(20)
    assert heard == []
    for count, fps in ((-1, 25.0), (3, 0.0)):
        with pytest.raises(ValueError, match="timeline"):
            timeline.set_frames(count, fps)
    with pytest.raises(ValueError, match="speeds"):
        timeline.set_speed(3.0)
    with pytest.raises(ValueError, match="sideways"):
        timeline.set_loop_mode("sideways")
