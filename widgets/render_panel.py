"""The 2D picture: image, overlay, comparison with what was observed, zoom and pan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from PySide6.QtCore import QEvent, QPoint, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPalette, QPen, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from widgets.images import to_array, to_qimage
from widgets.keys import keep_keys
from widgets.panel_marks import paint_cross, paint_legend, paint_tag, paint_wipe_handle
from widgets.theme import picture_background

COMPARE_MODES = ("off", "wipe", "difference")

#: From this zoom on (screen pixels an image pixel) pixels are drawn as squares.
NEAREST_FROM = 3.0

MIN_ZOOM, MAX_ZOOM = 0.05, 64.0

#: How near the pointer must be to the wipe line to take hold of it, and how far a press may move and still be a click; screen pixels.
GRIP, CLICK_SLACK = 8, 4

_KEYS = {
    Qt.Key.Key_Plus,
    Qt.Key.Key_Equal,
    Qt.Key.Key_Minus,
    Qt.Key.Key_0,
    Qt.Key.Key_1,
    Qt.Key.Key_BracketLeft,
    Qt.Key.Key_BracketRight,
}


class _Picture(NamedTuple):
    """An image as it came, and as Qt draws it."""

    rgb: np.ndarray
    drawn: QImage


class RenderPanel(QWidget):
    """Shows one picture. Positions in signals and markers are pixels of the full-size image, even while a smaller preview is shown."""

    hovered = Signal(int, int)
    clicked = Signal(int, int)
    split_changed = Signal(float)
    zoom_changed = Signal(float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Picture")
        self.setAccessibleDescription("Wheel zooms, drag pans, 0 fits, 1 shows pixels one to one, square brackets move the wipe line")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        keep_keys(self, _KEYS)
        self.setMouseTracking(True)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self._image: _Picture | None = None
        self._observed: _Picture | None = None
        self._difference: QImage | None = None
        self._overlay: QImage | None = None
        self._size = (1, 1)
        self._message = "Nothing to show yet"
        self._overlay_opacity = 1.0
        self._mode = "off"
        self._split = 0.5
        self._gain = 4.0
        self._marker: QPointF | None = None
        self._legend: list[tuple[str, QColor]] = []
        self._fitted = True
        self._zoom = 1.0
        self._origin = QPointF()  # where the image's corner lies in the widget
        self._press: QPointF | None = None
        self._last = QPointF()
        self._panning = self._splitting = False
        self._inside = False

    # What is shown

    def set_image(self, rgb: np.ndarray | None, size: tuple[int, int] | None = None) -> None:
        """Show a picture, uint8 [H, W, 3], or with None the message.

        `size` (width, height) is the full size that a smaller preview stands for.
        """
        self._image = None if rgb is None else _Picture(rgb, to_qimage(rgb))
        self._difference = None
        if rgb is not None:
            size = size or (rgb.shape[1], rgb.shape[0])
            if size != self._size:
                self._size = size
                self._fitted = True
            if self._fitted:
                self._fit()
        self.update()

    def set_message(self, text: str) -> None:
        """What to say when there is no picture."""
        self._message = text
        self.update()

    def set_overlay(self, rgba: np.ndarray | None) -> None:
        """Lay uint8 [H, W, 4] (any size; stretched over the image) on top."""
        self._overlay = None if rgba is None else to_qimage(rgba)
        self.update()

    def set_overlay_opacity(self, opacity: float) -> None:
        self._overlay_opacity = min(max(opacity, 0.0), 1.0)
        self.update()

    def overlay_opacity(self) -> float:
        return self._overlay_opacity

    def set_observed(self, rgb: np.ndarray | None) -> None:
        """The clip's own frame, uint8 [H, W, 3], to compare with."""
        self._observed = None if rgb is None else _Picture(rgb, to_qimage(rgb))
        self._difference = None
        self.update()

    def set_compare_mode(self, mode: str) -> None:
        if mode not in COMPARE_MODES:
            raise ValueError(f"unknown comparison {mode!r}; there are {', '.join(COMPARE_MODES)}")
        self._mode = mode
        self.update()

    def compare_mode(self) -> str:
        return self._mode

    def set_split(self, split: float) -> None:
        """Place the wipe line: the image left of this fraction of its width, the observed frame right of it."""
        self._split = min(max(split, 0.0), 1.0)
        self.update()

    def split(self) -> float:
        return self._split

    def set_difference_gain(self, gain: float) -> None:
        """Differences are shown `gain` times as bright as they are."""
        self._gain = gain
        self._difference = None
        self.update()

    def set_marker(self, x: float, y: float) -> None:
        self._marker = QPointF(x, y)
        self.update()

    def clear_marker(self) -> None:
        self._marker = None
        self.update()

    def set_legend(self, entries: Sequence[tuple[str, QColor]]) -> None:
        self._legend = list(entries)
        self.update()

    def grab_image(self) -> np.ndarray:
        """What is shown, uint8 [H, W, 3], at the picture's own resolution, without marker and legend."""
        if self._image is None:
            raise ValueError("there is no picture to grab")
        canvas = QImage(self._image.drawn.size(), QImage.Format.Format_RGB32)
        painter = QPainter(canvas)
        self._paint_picture(painter, QRectF(canvas.rect()), self._image)
        painter.end()
        return to_array(canvas)

    # Zoom

    def zoom(self) -> float:
        """Screen pixels an image pixel."""
        return self._zoom * self.devicePixelRatioF()

    def fit(self) -> None:
        """Show the whole picture, and keep doing so when the panel is resized."""
        self._fitted = True
        self._fit()
        self.update()

    def set_zoom(self, scale: float, about: QPointF | None = None) -> None:
        """Zoom to `scale` screen pixels an image pixel; what lies under `about` (widget position, default: centre) stays there."""
        about = about if about is not None else QRectF(self.rect()).center()
        fixed = self._to_image(about)
        self._zoom = min(max(scale, MIN_ZOOM), MAX_ZOOM) / self.devicePixelRatioF()
        self._fitted = False
        self._origin = about - fixed * self._zoom
        self._moved()

    def _fit(self) -> None:
        width, height = self._size
        self._zoom = max(min(self.width() / width, self.height() / height), 1e-3)
        self._origin = QPointF((self.width() - width * self._zoom) / 2, (self.height() - height * self._zoom) / 2)
        self.zoom_changed.emit(self.zoom())

    def _moved(self) -> None:
        """Keep at least a part of the picture in sight."""
        width, height = self._size[0] * self._zoom, self._size[1] * self._zoom
        margin = 40.0
        x = min(max(self._origin.x(), margin - width), self.width() - margin)
        y = min(max(self._origin.y(), margin - height), self.height() - margin)
        self._origin = QPointF(x, y)
        self.zoom_changed.emit(self.zoom())
        self.update()

    def _to_image(self, position: QPointF) -> QPointF:
        return (position - self._origin) / self._zoom

    def _to_widget(self, point: QPointF) -> QPointF:
        return self._origin + point * self._zoom

    def _target(self) -> QRectF:
        return QRectF(self._origin.x(), self._origin.y(), self._size[0] * self._zoom, self._size[1] * self._zoom)

    def _split_x(self) -> float:
        target = self._target()
        return target.left() + self._split * target.width()

    # Painting

    def paintEvent(self, event: QPaintEvent) -> None:
        with QPainter(self) as painter:  # ended even when painting fails; Qt crashes on a painter left open
            self._paint(painter)

    def _paint(self, painter: QPainter) -> None:
        painter.fillRect(self.rect(), picture_background(self.palette()))
        if self._image is None:
            painter.setPen(self.palette().color(QPalette.ColorRole.PlaceholderText))
            painter.drawText(
                self.rect().adjusted(24, 24, -24, -24), Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap.value, self._message
            )
            return
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, self.zoom() < NEAREST_FROM)
        self._paint_picture(painter, self._target(), self._image)
        self._paint_marks(painter)
        if self.hasFocus():
            painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Accent), 1))
            painter.drawRect(self.rect().adjusted(0, 0, -1, -1))

    def _paint_marks(self, painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if self._mode == "wipe" and self._observed is not None:
            paint_wipe_handle(painter, self._split_x(), self._target().intersected(QRectF(self.rect())))
        if self._marker is not None:
            paint_cross(painter, self._to_widget(self._marker))
        if self._legend:
            paint_legend(painter, QPointF(8, self.height() - 8), self._legend)
        if self._mode != "off" and self._observed is None:
            paint_tag(painter, QPointF(8, 8), "no observed frame to compare with")
        elif self._mode == "difference":
            paint_tag(painter, QPointF(8, 8), f"difference × {self._gain:g}")

    def _paint_picture(self, painter: QPainter, target: QRectF, shown: _Picture) -> None:
        if self._mode == "difference" and self._observed is not None:
            painter.drawImage(target, self._difference_image(shown, self._observed))
        else:
            painter.drawImage(target, shown.drawn)
        if self._overlay is not None and self._overlay_opacity > 0:
            painter.setOpacity(self._overlay_opacity)
            painter.drawImage(target, self._overlay)
            painter.setOpacity(1.0)
        if self._mode == "wipe" and self._observed is not None:
            painter.save()
            right = QRectF(target)
            right.setLeft(target.left() + self._split * target.width())
            painter.setClipRect(right)
            painter.drawImage(target, self._observed.drawn)
            painter.restore()

    def _difference_image(self, shown: _Picture, observed: _Picture) -> QImage:
        if self._difference is None:
            height, width = observed.rgb.shape[:2]
            rgb = shown.rgb if shown.rgb.shape[:2] == (height, width) else cv2.resize(shown.rgb, (width, height))
            difference = np.abs(rgb.astype(np.int16) - observed.rgb)
            self._difference = to_qimage(np.minimum(difference * np.float32(self._gain), 255.0).astype(np.uint8))
        return self._difference

    # Events

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._press = self._last = event.position()
        self._panning = False
        self._splitting = event.button() == Qt.MouseButton.LeftButton and self._on_handle(event.position())

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._press is not None and event.buttons():
            if self._splitting:
                self._user_split((event.position().x() - self._target().left()) / self._target().width())
            elif self._panning or (event.position() - self._press).manhattanLength() > CLICK_SLACK:
                self._panning = True
                self._fitted = False
                self._origin += event.position() - self._last
                self._moved()
        self._last = event.position()
        self._update_cursor(event.position())
        self._hover(event.position().toPoint())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        click = self._press is not None and not self._panning and not self._splitting and event.button() == Qt.MouseButton.LeftButton
        self._press = None
        self._panning = self._splitting = False
        point = self._pixel(event.position())
        if click and point is not None:
            self.clicked.emit(*point)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if not self._on_handle(event.position()):
            self.fit()

    def wheelEvent(self, event: QWheelEvent) -> None:
        if self._image is not None and event.angleDelta().y():
            self.set_zoom(self.zoom() * 1.2 ** (event.angleDelta().y() / 120.0), event.position())
            event.accept()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        step = 0.1 if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 0.02
        match event.key():
            case Qt.Key.Key_Plus | Qt.Key.Key_Equal:
                self.set_zoom(self.zoom() * 1.25)
            case Qt.Key.Key_Minus:
                self.set_zoom(self.zoom() / 1.25)
            case Qt.Key.Key_0:
                self.fit()
            case Qt.Key.Key_1:
                self.set_zoom(1.0)
            case Qt.Key.Key_BracketLeft if self._mode == "wipe":
                self._user_split(self._split - step)
            case Qt.Key.Key_BracketRight if self._mode == "wipe":
                self._user_split(self._split + step)
            case _:
                super().keyPressEvent(event)

    def leaveEvent(self, event: QEvent) -> None:
        self._hover(QPoint(-1, -1))

    def resizeEvent(self, event: QResizeEvent) -> None:
        if self._fitted:
            self._fit()
        elif event.oldSize().isValid():
            grown = event.size() - event.oldSize()
            self._origin += QPointF(grown.width() / 2, grown.height() / 2)
            self._moved()

    def focusInEvent(self, event: QEvent) -> None:
        self.update()

    def focusOutEvent(self, event: QEvent) -> None:
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(640, 512)

    def _on_handle(self, position: QPointF) -> bool:
        wiping = self._mode == "wipe" and self._observed is not None and self._image is not None
        return wiping and abs(position.x() - self._split_x()) <= GRIP

    def _user_split(self, split: float) -> None:
        self.set_split(split)
        self.split_changed.emit(self._split)

    def _update_cursor(self, position: QPointF) -> None:
        if self._splitting or self._on_handle(position):
            self.setCursor(Qt.CursorShape.SplitHCursor)
        elif self._panning:
            self.setCursor(Qt.CursorShape.ClosedHandCursor)
        else:
            self.setCursor(Qt.CursorShape.CrossCursor if self._image is not None else Qt.CursorShape.ArrowCursor)

    def _pixel(self, position: QPointF) -> tuple[int, int] | None:
        if self._image is None or not QRectF(self.rect()).contains(position):
            return None
        point = self._to_image(position)
        x, y = int(np.floor(point.x())), int(np.floor(point.y()))
        return (x, y) if 0 <= x < self._size[0] and 0 <= y < self._size[1] else None

    def _hover(self, position: QPoint) -> None:
        pixel = self._pixel(QPointF(position))
        if pixel is not None or self._inside:
            self.hovered.emit(*(pixel or (-1, -1)))
        self._inside = pixel is not None
