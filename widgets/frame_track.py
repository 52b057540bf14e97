"""The line of frames: a slider with marks below and curves above."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSignalBlocker, QSize, Qt
from PySide6.QtGui import QColor, QHelpEvent, QKeyEvent, QMouseEvent, QPainter, QPainterPath, QPalette, QPen
from PySide6.QtWidgets import QSizePolicy, QSlider, QToolTip, QWidget

from degense.widgets.forms import Painted
from degense.widgets.keys import ARROWS, keep_keys
from degense.widgets.theme import faded, label_colour

_MARGIN, _MARKS, _LINE, _STRIP = 10, 12, 12, 24


class FrameTrack(Painted, QSlider):
    """A slider over the frames: press anywhere to go there; Shift with the arrows makes steps of ten."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self.setAccessibleName("Frame")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setPageStep(10)
        keep_keys(self, ARROWS)
        self._test: set[int] = set()
        self._labelled: dict[str, set[int]] = {}
        self._strips: dict[str, tuple[np.ndarray, QColor]] = {}
        self._played: tuple[int, int] | None = None
        self._events: dict[int, str] = {}

    def set_frames(self, count: int) -> None:
        self._test, self._labelled, self._played, self._events = set(), {}, None, {}
        with QSignalBlocker(self):
            self.setRange(0, max(count - 1, 0))
        self.show_frame(0)
        self.set_strips({})

    def show_frame(self, frame: int) -> None:
        """Move the slider without telling anyone."""
        with QSignalBlocker(self):
            self.setValue(frame)

    def set_marks(self, test: Iterable[int], labelled: Mapping[str, Iterable[int]]) -> None:
        """Mark held-out frames (below the line, hollow) and frames with labels (filled), in the colour of their kind (`label_colour`)."""
        self._test, self._labelled = set(test), {kind: set(frames) for kind, frames in labelled.items()}
        self.update()

    def set_events(self, events: Mapping[int, str]) -> None:
        """Mark frames with notes, as diamonds on the line; a tooltip shows the note."""
        self._events = dict(events)
        self.update()

    def set_played(self, played: tuple[int, int] | None) -> None:
        """Bracket the frames that are played; None: all."""
        self._played = played
        self.update()

    def set_strips(self, strips: Mapping[str, tuple[np.ndarray, QColor]]) -> None:
        """Lay curves over time, values [count], such as the area of a mask, above the line, each in its colour.

        NaN leaves a gap. Each curve has its own scale from 0.
        """
        for name, (values, _) in strips.items():
            if len(values) != self.maximum() + 1:
                raise ValueError(f"the curve {name!r} has {len(values)} values for {self.maximum() + 1} frames")
        self._strips = dict(strips)
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(320, _STRIP + _LINE + _MARKS)

    minimumSizeHint = sizeHint

    # Geometry

    def _x(self, frame: float) -> float:
        return _MARGIN + (self.width() - 2 * _MARGIN) * frame / max(self.maximum(), 1)

    def _frame_at(self, x: float) -> int:
        return round((x - _MARGIN) / max(self.width() - 2 * _MARGIN, 1) * self.maximum())

    # Painting

    def _paint(self, painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        group = QPalette.ColorGroup.Active if self.isEnabled() else QPalette.ColorGroup.Disabled
        accent = self.palette().color(QPalette.ColorRole.Accent) if self.isEnabled() else self.palette().color(QPalette.ColorRole.Mid)
        text = self.palette().color(group, QPalette.ColorRole.WindowText)
        top = self.height() - _LINE - _MARKS
        middle = top + _LINE / 2
        for values, colour in self._strips.values():
            self._paint_strip(painter, values, colour, top)
        groove = QRectF(_MARGIN, middle - 2, self.width() - 2 * _MARGIN, 4)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(self.palette().color(QPalette.ColorRole.Mid))
        painter.drawRoundedRect(groove, 2, 2)
        x = self._x(self.value())
        painter.setBrush(accent)
        painter.drawRoundedRect(QRectF(groove.left(), groove.top(), x - groove.left(), 4), 2, 2)
        if self._played is not None:
            self._paint_played(painter, middle, text)
        self._paint_marks(painter, middle + _LINE / 2 + 1)
        self._paint_events(painter, middle, text)
        if self._strips:
            painter.setPen(QPen(text, 1))
            painter.drawLine(QPointF(x, 0), QPointF(x, middle))
        painter.setPen(QPen(text if self.hasFocus() else self.palette().color(QPalette.ColorRole.Window), 1.5))
        painter.setBrush(accent)
        painter.drawEllipse(QPointF(x, middle), 6, 6)

    def _paint_played(self, painter: QPainter, middle: float, ink: QColor) -> None:
        """A bracket around the frames that are played."""
        assert self._played is not None
        left, right = (self._x(frame) for frame in self._played)
        painter.fillRect(QRectF(left, middle - _LINE / 2, right - left, _LINE), faded(self.palette().color(QPalette.ColorRole.Accent), 50))
        painter.setPen(QPen(ink, 1.6))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for x, inwards in ((left, 3), (right, -3)):
            top, bottom = middle - _LINE / 2, middle + _LINE / 2
            painter.drawPolyline([QPointF(x + inwards, top), QPointF(x, top), QPointF(x, bottom), QPointF(x + inwards, bottom)])
        painter.setPen(Qt.PenStyle.NoPen)

    def _paint_strip(self, painter: QPainter, values: np.ndarray, colour: QColor, height: float) -> None:
        finite = np.isfinite(values)
        if not finite.any():
            return
        scale = (height - 3) / max(float(values[finite].max()), 1e-12)
        # No more points than pixels: of the frames that share a pixel the largest value is drawn.
        step = max(1, len(values) // max(self.width(), 1))
        for run in _pieces(values):
            peaks = [(run[i], max(float(values[run[i : i + step]].max()), 0.0)) for i in range(0, len(run), step)]
            points = [QPointF(self._x(frame), height - scale * peak) for frame, peak in peaks]
            line = QPainterPath(points[0])
            for point in points[1:]:
                line.lineTo(point)
            area = QPainterPath(line)
            area.lineTo(points[-1].x(), height)
            area.lineTo(points[0].x(), height)
            painter.fillPath(area, faded(colour, 40))
            painter.strokePath(line, QPen(colour, 1.3))

    def _paint_events(self, painter: QPainter, middle: float, ink: QColor) -> None:
        painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Window), 1))
        painter.setBrush(ink)
        for frame in self._events:
            x = self._x(frame)
            painter.drawPolygon([QPointF(x - 4, middle), QPointF(x, middle - 6), QPointF(x + 4, middle), QPointF(x, middle + 6)])

    def _paint_marks(self, painter: QPainter, y: float) -> None:
        quiet = self.palette().color(QPalette.ColorRole.PlaceholderText)
        spacing = (self.width() - 2 * _MARGIN) / max(self.maximum(), 1)
        painter.setPen(QPen(quiet, 1.2))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for frame in self._test:
            x = self._x(frame)
            slope = 3 if spacing >= 3 else 0
            painter.drawPolyline([QPointF(x - slope, y + 4), QPointF(x, y), QPointF(x + slope, y + 4)])
        width = min(max(0.8 * spacing, 2), 12)
        for kind, frames in self._labelled.items():
            colour = label_colour(kind, self.palette())
            for frame in frames:
                painter.fillRect(QRectF(self._x(frame) - width / 2, y + 5, width, 5), colour)

    # Events

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self.setSliderDown(True)
            self.setValue(self._frame_at(event.position().x()))
            event.accept()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self.isSliderDown():
            self.setValue(self._frame_at(event.position().x()))

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        self.setSliderDown(False)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        pages = {Qt.Key.Key_PageUp: -1, Qt.Key.Key_PageDown: 1}.get(Qt.Key(event.key()), 0)  # down is on, as in a text
        self.setValue(self.value() + pages * self.pageStep())
        if not pages:
            self.setSingleStep(10 if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 1)
            super().keyPressEvent(event)

    def event(self, event) -> bool:
        if isinstance(event, QHelpEvent):
            frame = min(max(self._frame_at(event.pos().x()), 0), self.maximum())
            kinds = [kind for kind, frames in (("held out for testing", self._test), *self._labelled.items()) if frame in frames]
            lines = [f"Frame {frame}" + (f" ({', '.join(kinds)})" if kinds else "")]
            lines += [self._events[frame] or "event"] if frame in self._events else []
            lines += [f"{name}: {values[frame]:.4g}" for name, (values, _) in self._strips.items() if frame < len(values)]
            QToolTip.showText(event.globalPos(), "\n".join(lines), self)
            return True
        return super().event(event)


def _pieces(values: np.ndarray) -> Iterator[np.ndarray]:
    """Indices of each run of finite values, [n] each, one after another."""
    known = np.flatnonzero(np.isfinite(values))
    return (run for run in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if len(run))
