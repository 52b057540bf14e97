"""A pointer in the 2D view that keys move and press: painting, placing points, measuring and clicking without a mouse.

The pointer sends the panel the events that a mouse would send, so that every tool answers to it without knowing of it.
"""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QKeyEvent, QMouseEvent, QPainter, QPen
from PySide6.QtWidgets import QApplication

from degense.app.features.viewer.controller import Viewer
from degense.widgets.frame.panel_marks import paint_tag
from degense.widgets.frame.panel_zoom import PanelZoom

_WAYS = {Qt.Key.Key_Left: (-1, 0), Qt.Key.Key_Right: (1, 0), Qt.Key.Key_Up: (0, -1), Qt.Key.Key_Down: (0, 1)}
_ENTER = (Qt.Key.Key_Return, Qt.Key.Key_Enter)
_KEYS = frozenset({*_WAYS, *_ENTER, Qt.Key.Key_Space, Qt.Key.Key_Escape})
_CHORD = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier | Qt.KeyboardModifier.MetaModifier
#: Pixels of the frame that an arrow moves with Shift, and how long the arms of the cross are, screen pixels.
FAR, ARM = 10, 22
#: How near to the border of the view the pointer may come before the frame is moved, screen pixels.
EDGE = 24
HINT = "Arrows move, with Shift farther · Space clicks · Enter holds · Escape leaves"


class KeyPointer(QObject):
    """A cross at a pixel of the frame. While it is shown and the 2D view has the keyboard, arrows, Space, Enter and Escape are its own."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self._viewer, self._panel = viewer, viewer.panel
        self.on = False
        self.at = QPointF()  # pixels of the frame, the middle of one
        self.held = False  # whether the left button is down
        self._panel.installEventFilter(self)
        self._panel.marks.painters.append(self._paint)

    def toggle(self) -> None:
        """Show the pointer, in the middle of the view at first, or no longer."""
        self.on = not self.on
        if self.on:
            if self.at.isNull():
                self.at = self._panel.zoom.to_image(QRectF(self._panel.rect()).center())
            self._panel.setFocus()
            self._move(0, 0)
        elif self.held:
            self._release()
        self._panel.update()
        self._viewer.shell.refresh()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if self.on and self.held and event.type() == QEvent.Type.FocusOut:
            self._release()
        if not self.on or not isinstance(event, QKeyEvent) or event.key() not in _KEYS or event.modifiers() & _CHORD:
            return False
        if event.type() == QEvent.Type.ShortcutOverride:
            event.accept()
        elif event.type() == QEvent.Type.KeyPress:
            self._pressed(Qt.Key(event.key()), bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier), event.isAutoRepeat())
        elif event.key() == Qt.Key.Key_Space and self.held and not event.isAutoRepeat():
            self._release()
        return True

    def _pressed(self, key: Qt.Key, far: bool, repeated: bool) -> None:
        if key in _WAYS:
            x, y = _WAYS[key]
            self._move(x * (FAR if far else 1), y * (FAR if far else 1))
        elif repeated:
            return
        elif key == Qt.Key.Key_Escape:
            if self.held:
                self._release()
            else:
                self.toggle()
        elif self.held:
            self._release()
        else:
            self._press()
            if key in _ENTER and self._panel.tool is None:  # nothing to be drawn: a click
                self._release()

    def _move(self, x: float, y: float) -> None:
        """By pixels of the frame, within it; the frame follows where the pointer would leave the view."""
        width, height = self._panel.zoom.image
        if width and height:
            left, top = int(self.at.x() + x), int(self.at.y() + y)
            self.at = QPointF(min(max(left, 0), width - 1) + 0.5, min(max(top, 0), height - 1) + 0.5)
            inside = QRectF(self._panel.rect()).adjusted(EDGE, EDGE, -EDGE, -EDGE)
            place = self._panel.zoom.to_widget(self.at)
            nearest = QPointF(min(max(place.x(), inside.left()), inside.right()), min(max(place.y(), inside.top()), inside.bottom()))
            if nearest != place:
                self._panel.zoom.move(nearest - place)
            self._send(QEvent.Type.MouseMove, Qt.MouseButton.NoButton)

    def _press(self) -> None:
        self.held = True
        self._send(QEvent.Type.MouseButtonPress, Qt.MouseButton.LeftButton)

    def _release(self) -> None:
        self.held = False
        self._send(QEvent.Type.MouseButtonRelease, Qt.MouseButton.LeftButton)

    def _send(self, kind: QEvent.Type, button: Qt.MouseButton) -> None:
        """What a mouse at the pointer would send."""
        place = self._panel.zoom.to_widget(self.at)
        buttons = Qt.MouseButton.LeftButton if self.held else Qt.MouseButton.NoButton
        event = QMouseEvent(kind, place, self._panel.mapToGlobal(place), button, buttons, Qt.KeyboardModifier.NoModifier)
        QApplication.sendEvent(self._panel, event)
        self._panel.update()

    def _paint(self, painter: QPainter, zoom: PanelZoom) -> None:
        if not self.on or not zoom.image[0]:
            return
        place = zoom.to_widget(self.at)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for colour, width in ((QColor(0, 0, 0, 200), 4.0), (QColor(255, 214, 0) if self.held else QColor(255, 255, 255), 1.6)):
            painter.setPen(QPen(colour, width))
            for x, y in _WAYS.values():
                painter.drawLine(place + QPointF(5 * x, 5 * y), place + QPointF(ARM * x, ARM * y))
            painter.drawEllipse(place, 5, 5)
        paint_tag(painter, place + QPointF(8, 8), f"{int(self.at.x())}, {int(self.at.y())}")
        if self._panel.hasFocus():  # in the view, as the status bar of a small window has no room for it
            paint_tag(painter, QPointF(8, 36), HINT)
