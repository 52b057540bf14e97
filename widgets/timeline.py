"""Slider, buttons and clock that choose the frame."""

from __future__ import annotations

import time
from collections import deque

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QKeyEvent, QResizeEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from degense.widgets import forms
from degense.widgets.elided import ElidedLabel
from degense.widgets.frame_track import FrameTrack
from degense.widgets.glyphs import GlyphButton

SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0)

_LOOP_TITLES = {"once": "Once", "loop": "Loop", "bounce": "Back and forth"}
LOOP_MODES = tuple(_LOOP_TITLES)

#: Playback goes on after this many seconds when `frame_drawn` is not called.
PATIENCE = 0.5
EDGE = 6  # pixels beside what stands here


def played_frame(phase: float, count: int, mode: str) -> tuple[int, bool]:
    """Frame shown after playing `phase` frames from frame 0, and whether playback has ended."""
    step = int(phase)
    if mode == "once" or count < 2:
        return min(step, count - 1), step >= count - 1
    if mode == "loop":
        return step % count, False
    folded = step % (2 * (count - 1))
    return min(folded, 2 * (count - 1) - folded), False


class Timeline(QWidget):
    """Slider over the frames with playback in real time.

    Frames that cannot be drawn in time are left out, and the rate that is reached is shown.
    """

    frame_changed = Signal(int)
    playing_changed = Signal(bool)
    speed_changed = Signal(float)
    loop_mode_changed = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Timeline")
        self._count = 0
        self._fps = 25.0
        self._playing = False
        self._played: tuple[int, int] | None = None
        self._phase = 0.0
        self._ticked = 0.0
        self._asked: float | None = None  # when the frame not yet drawn was requested
        self._drawn: deque[float] = deque(maxlen=120)
        self._clock = time.perf_counter
        self._tick_timer = QTimer(self)
        self._tick_timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._tick_timer.timeout.connect(self._tick)
        self._emit_timer = QTimer(self, singleShot=True, interval=0)
        self._emit_timer.timeout.connect(lambda: self.frame_changed.emit(self.frame()))

        self.track = FrameTrack(self)  # the slider, with its marks and curves
        self.track.valueChanged.connect(self._scrubbed)
        self._play_button = GlyphButton("play", "Play", clicked=self.toggle_play)
        self._move_buttons = [
            GlyphButton("first", "First frame", clicked=lambda: self.step(-self._count)),
            GlyphButton("previous", "Previous frame", clicked=lambda: self.step(-1)),
            GlyphButton("next", "Next frame", clicked=lambda: self.step(1)),
            GlyphButton("last", "Last frame", clicked=lambda: self.step(self._count)),
        ]
        for button in self._move_buttons[1:3]:
            button.setAutoRepeat(True)
        speeds = [(speed, f"{speed:g} ×") for speed in SPEEDS]
        self._speed_box = forms.choice("Playback speed", speeds, lambda: self.speed_changed.emit(self.speed()))
        self._speed_box.setToolTip("Playback speed")
        self._loop_box = forms.choice("At the end", _LOOP_TITLES.items(), lambda: self.loop_mode_changed.emit(self.loop_mode()))
        self._loop_box.setToolTip("What happens at the end")
        self._readout = forms.label(name="Frame and time", wrap=False)
        self._rate = ElidedLabel("Frames a second, reached and wanted", secondary=True)
        self._loop_box.setMinimumContentsLength(4)
        self._loop_box.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
        self._arrange()
        self.set_speed(1.0)
        self.set_loop_mode("loop")
        self.set_frames(0)

    def _arrange(self) -> None:
        first, previous, following, last = self._move_buttons
        buttons = (first, previous, self._play_button, following, last)
        self._row = forms.row(*buttons, 8, self._speed_box, 4, self._loop_box, 0, self._rate, 12, self._readout, spacing=2)
        forms.column(self.track, self._row, spacing=4, parent=self).setContentsMargins(EDGE, 4, EDGE, 4)

    # The frames

    def set_frames(self, count: int, fps: float = 25.0) -> None:
        """Another sequence: frame 0 is shown, playback stops, marks and curves are removed. Without frames all is disabled."""
        if count < 0 or not fps > 0:
            raise ValueError(f"a timeline has 0 frames or more at a positive rate, not {count} at {fps} a second")
        self.pause()
        self._count, self._fps = count, fps
        self._played = None
        self.track.set_frames(count)
        self._emit_timer.stop()
        for widget in (self.track, self._play_button, *self._move_buttons, self._speed_box, self._loop_box):
            widget.setEnabled(count > 0)
        self._show_readout()

    def count(self) -> int:
        return self._count

    def frame(self) -> int:
        return self.track.value()

    def set_frame(self, frame: int) -> None:
        """Show another frame without telling anyone; out of range is clipped."""
        self.track.show_frame(frame)
        self._phase = float(self.frame())
        self._show_readout()

    def set_played(self, first: int | None, last: int | None) -> None:
        """Play only from `first` to `last` (None: from the start, to the end); everything can still be scrubbed."""
        first, last = first or 0, self._count - 1 if last is None else min(last, self._count - 1)
        self._played = (first, last) if 0 <= first < last and (first, last) != (0, self._count - 1) else None
        self.track.set_played(self._played)

    def played(self) -> tuple[int, int]:
        """First and last frame that are played."""
        return self._played or (0, max(self._count - 1, 0))

    def step(self, frames: int) -> None:
        """Go on by some frames, as the user does; playback pauses."""
        self.pause()
        self.track.setValue(self.frame() + frames)

    # Playback

    def is_playing(self) -> bool:
        return self._playing

    def play(self) -> None:
        if self._playing or self._count < 2:
            return
        first, last = self.played()
        if not first <= self.frame() <= last or (self.loop_mode() == "once" and self.frame() == last):
            self.track.setValue(first)
        self._playing = True
        self._phase = float(self.frame())
        self._ticked = self._clock()
        self._asked = None
        self._drawn.clear()
        self._tick_timer.start(8)
        self._show_playing()

    def pause(self) -> None:
        if not self._playing:
            return
        self._playing = False
        self._tick_timer.stop()
        self._show_playing()

    def toggle_play(self) -> None:
        self.pause() if self._playing else self.play()

    def speed(self) -> float:
        return self._speed_box.currentData()

    def set_speed(self, speed: float) -> None:
        if speed not in SPEEDS:
            raise ValueError(f"speeds are {SPEEDS}, not {speed}")
        self._speed_box.setCurrentIndex(SPEEDS.index(speed))

    def loop_mode(self) -> str:
        return self._loop_box.currentData()

    def set_loop_mode(self, mode: str) -> None:
        if mode not in LOOP_MODES:
            raise ValueError(f"unknown loop mode {mode!r}; there are {', '.join(LOOP_MODES)}")
        self._loop_box.setCurrentIndex(LOOP_MODES.index(mode))

    def frame_drawn(self) -> None:
        """The frame last requested is on the screen.

        Playback waits for this, so that slow drawing drops frames instead of queueing them.
        """
        self._asked = None
        self._drawn.append(self._clock())
        self._show_rate()

    # Inside

    def _tick(self) -> None:
        now = self._clock()
        self._phase += (now - self._ticked) * self._fps * self.speed()
        self._ticked = now
        first, last = self.played()
        step, ended = played_frame(max(self._phase - first, 0.0), last - first + 1, self.loop_mode())
        frame = first + step
        waiting = self._asked is not None and now - self._asked < PATIENCE
        if frame != self.frame() and not waiting:
            self.track.show_frame(frame)
            self._show_readout()
            self._asked = now
            self.frame_changed.emit(frame)
        if ended and self.frame() == frame:
            self.pause()

    def _scrubbed(self, frame: int) -> None:
        """The user moved the slider: many moves in one turn of the event loop become one signal with the latest frame."""
        self._phase = float(frame)
        self._show_readout()
        self._emit_timer.start()

    def _show_playing(self) -> None:
        self._play_button.set_glyph(*(("pause", "Pause") if self._playing else ("play", "Play")))
        self._show_rate()
        self.playing_changed.emit(self._playing)

    def _show_rate(self) -> None:
        now = self._clock()
        recent = [t for t in self._drawn if now - t < 1.0]
        if not self._playing:
            self._rate.setText("")
        elif len(recent) > 1 and recent[-1] > recent[0]:
            reached = (len(recent) - 1) / (recent[-1] - recent[0])
            self._rate.setText(f"{reached:.0f} / {self._fps * self.speed():.3g} fps")

    def _show_readout(self) -> None:
        """Frame and time; the frame, or its number alone, where there is no room for both."""
        last = self._count - 1
        number, seconds = f"{self.frame()} / {last}", f"{self.frame() / self._fps:.2f} / {last / self._fps:.2f} s"
        texts = (f"Frame {number}    {seconds}", f"Frame {number}", number) if self._count else ("No frames",)
        self._readout.setMinimumWidth(self._readout.fontMetrics().horizontalAdvance(f"{last} / {last}"))
        self._readout.setToolTip(texts[0])
        for text in texts:
            self._readout.setText(text)
            self._row.invalidate()
            if self._row.sizeHint().width() <= self.width() - 2 * EDGE:
                break

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._show_readout()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key.Key_Space:
            self.toggle_play()
        else:
            super().keyPressEvent(event)
