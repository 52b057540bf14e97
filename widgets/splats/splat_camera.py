"""The camera of the 3D view: locked to one of the clip's, or moved freely by mouse and keys."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent, QWheelEvent
from PySide6.QtWidgets import QWidget

from degense.engine.camera import Camera
from degense.widgets.splats.camera_moves import dolly, framing, orbit, pan

#: A press and release closer than this is a click, pixels.
CLICK_SLACK = 4

#: How much more of the distance to the middle of the scene a step of the wheel cuts away.
CUT = 0.05


class SplatCamera(QObject):
    """Through which camera the splats are seen."""

    changed = Signal()  # another camera: the view is to be drawn again
    moved = Signal(object)  # (camera)
    locked_changed = Signal(bool)  # (locked)

    def __init__(self, canvas: QWidget) -> None:
        super().__init__(canvas)
        self._canvas = canvas
        self.means = np.zeros((0, 3), np.float32)  # float [N, 3]; centres of the splats; their median is the point one turns around
        self._clip_camera: Camera | None = None
        self._free: Camera | None = None

    def lock(self, camera: Camera) -> None:
        """Show what a camera of the clip sees."""
        self._clip_camera, self._free = camera, None
        self.changed.emit()

    def set_free(self, camera: Camera) -> None:
        """Unlock, and move freely from this camera on."""
        self._free = camera
        self.changed.emit()

    def fly_to(self, camera: Camera) -> None:
        """As `set_free`, and `moved` is emitted, but not `locked_changed`."""
        self.set_free(camera)
        self.moved.emit(camera)

    def move(self, camera: Camera) -> None:
        """As `fly_to`, by the user: leaving the lock is reported."""
        was_locked = self.is_locked()
        self.fly_to(camera)
        if was_locked:
            self.locked_changed.emit(False)

    def shift(self, x: float, y: float) -> None:
        """Move sideways, by the user, so that the middle of the scene moves by logical pixels."""
        ratio = self._canvas.devicePixelRatioF()
        self.move(pan(self.viewport(), self.pivot(), x * ratio, y * ratio))

    def is_locked(self) -> bool:
        return self._free is None and self._clip_camera is not None

    def note(self) -> str:
        """What the view says about its camera."""
        if self.is_locked():
            return "Surgeon’s view"
        return "Free camera – V goes back" if self._clip_camera is not None else "Free camera"

    def current(self) -> Camera:
        """The clip's own camera when locked, else one whose image is the whole view in device pixels."""
        return self._clip_camera if self._free is None and self._clip_camera is not None else self.viewport()

    def viewport(self) -> Camera:
        """The camera whose image is the whole view in device pixels."""
        ratio = self._canvas.devicePixelRatioF()
        width, height = max(1, round(self._canvas.width() * ratio)), max(1, round(self._canvas.height() * ratio))
        camera = self._free or self._clip_camera
        return framing(self.means, width, height) if camera is None else camera.letterboxed(width, height)

    def pivot(self) -> np.ndarray:
        """The point [3] one turns around: the middle of the scene."""
        return np.median(self.means, 0).astype(np.float64) if len(self.means) else np.zeros(3)


class CameraMouse(QObject):
    """Moves the camera with the mouse and the keys of the canvas: Ctrl with arrows turns, plus and minus come closer and back off."""

    clicked = Signal(QPointF)  # (position) without a drag; logical pixels of the canvas
    cut = Signal(float)  # (step) the wheel was turned with Ctrl

    def __init__(self, canvas: QWidget, camera: SplatCamera) -> None:
        super().__init__(canvas)
        self._canvas, self._camera = canvas, camera
        self._press: QPointF | None = None
        self._last = QPointF()
        self._dragging = False
        canvas.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        kind = event.type()
        if isinstance(event, QMouseEvent):
            if kind == QEvent.Type.MouseButtonPress:
                self._pressed(event)
            elif kind == QEvent.Type.MouseMove:
                self._dragged(event)
            elif kind == QEvent.Type.MouseButtonRelease:
                self._released(event)
            return True
        if isinstance(event, QWheelEvent):
            turns = event.angleDelta().y() / 120.0
            if event.modifiers() & Qt.KeyboardModifier.ControlModifier:
                self.cut.emit(CUT * turns)
            else:
                self._dolly(0.9**turns)
            return True
        if isinstance(event, QKeyEvent) and kind == QEvent.Type.KeyPress:
            self._key(event)
            return True
        return kind == QEvent.Type.KeyRelease

    def _pressed(self, event: QMouseEvent) -> None:
        self._canvas.setFocus(Qt.FocusReason.MouseFocusReason)
        self._press = self._last = event.position()
        self._dragging = False

    def _dragged(self, event: QMouseEvent) -> None:
        if self._press is None or not event.buttons():
            return
        if not self._dragging and (event.position() - self._press).manhattanLength() <= CLICK_SLACK:
            return
        self._dragging = True
        step = event.position() - self._last
        self._last = event.position()
        if event.buttons() & Qt.MouseButton.LeftButton and not event.modifiers() & Qt.KeyboardModifier.ShiftModifier:
            turn = np.pi / max(self._canvas.height(), 1)
            self._orbit(step.x() * turn, step.y() * turn)
        elif event.buttons() & Qt.MouseButton.RightButton:
            self._dolly(1.01 ** step.y())
        else:
            self._camera.shift(step.x(), step.y())

    def _released(self, event: QMouseEvent) -> None:
        click = self._press is not None and not self._dragging and event.button() == Qt.MouseButton.LeftButton
        self._press, self._dragging = None, False
        if click:
            self.clicked.emit(event.position())

    def _key(self, event: QKeyEvent) -> None:
        turn = np.radians(5.0) if event.modifiers() & Qt.KeyboardModifier.ControlModifier else 0.0
        match event.key():
            case Qt.Key.Key_Left if turn:
                self._orbit(-turn, 0.0)
            case Qt.Key.Key_Right if turn:
                self._orbit(turn, 0.0)
            case Qt.Key.Key_Up if turn:
                self._orbit(0.0, -turn)
            case Qt.Key.Key_Down if turn:
                self._orbit(0.0, turn)
            case Qt.Key.Key_Plus | Qt.Key.Key_Equal:
                self._dolly(0.9)
            case Qt.Key.Key_Minus:
                self._dolly(1 / 0.9)
            case _:
                event.ignore()  # goes on to the parents

    def _orbit(self, yaw: float, pitch: float) -> None:
        self._camera.move(orbit(self._camera.viewport(), self._camera.pivot(), yaw, pitch))

    def _dolly(self, factor: float) -> None:
        self._camera.move(dolly(self._camera.viewport(), self._camera.pivot(), factor))
