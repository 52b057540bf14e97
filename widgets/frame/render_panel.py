"""The 2D picture: image, overlay, comparison with what was observed, zoom and pan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QEvent, QPoint, QPointF, QRectF, QSize, QSizeF, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPalette, QPen, QPolygonF, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from degense.widgets.frame.images import to_qimage
from degense.widgets.frame.panel_marks import paint_cross, paint_legend, paint_tag, paint_wipe_handle
from degense.widgets.frame.panel_tools import PanelTool, paint_outline
from degense.widgets.frame.panel_zoom import MAX_ZOOM, MIN_ZOOM, PanelZoom
from degense.widgets.frame.picture_stack import COMPARE_MODES, PictureStack
from degense.widgets.keys import keep_keys
from degense.widgets.theme import picture_background

#: From this zoom on (screen pixels an image pixel) pixels are drawn as squares.
NEAREST_FROM = 3.0

#: How long each of the two pictures is shown while they blink, milliseconds.
BLINK_MS = 500

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
        self._stack = PictureStack()
        self._tool: PanelTool | None = None
        self._using_tool = False
        self._look = PanelZoom()
        self._message = "Nothing to show yet"
        self._title = ""
        self._marker: QPointF | None = None
        self._outline = QPolygonF()
        self._legend: list[tuple[str, QColor]] = []
        self._press: QPointF | None = None
        self._last = QPointF()
        self._panning = self._splitting = False
        self._inside = False
        self._blinking = QTimer(self)
        self._blinking.setInterval(BLINK_MS)
        self._blinking.timeout.connect(self._blink)

    # What is shown

    def set_image(self, rgb: np.ndarray | None, size: tuple[int, int] | None = None) -> None:
        """Show a picture, uint8 [H, W, 3], or with None the message.

        `size` (width, height) is the full size that a smaller preview stands for.
        """
        self._stack.set_image(rgb)
        if rgb is not None:
            size = size or (rgb.shape[1], rgb.shape[0])
            if size != self._look.image:
                self._look.image = size
                self._look.fitted = True
            if self._look.fitted:
                self._fit()
        self.update()

    def has_image(self) -> bool:
        return self._stack.image is not None

    def set_message(self, text: str) -> None:
        """What to say when there is no picture."""
        self._message = text
        self.update()

    def set_title(self, text: str) -> None:
        """A name in the corner, to tell two panels apart; empty for none."""
        self._title = text
        self.update()

    def set_overlay(self, rgba: np.ndarray | None) -> None:
        """Lay uint8 [H, W, 4] (any size; stretched over the image) on top."""
        self._stack.overlay = None if rgba is None else to_qimage(rgba)
        self.update()

    def set_overlay_opacity(self, opacity: float) -> None:
        self._stack.overlay_opacity = min(max(opacity, 0.0), 1.0)
        self.update()

    def overlay_opacity(self) -> float:
        return self._stack.overlay_opacity

    def set_labels(self, rgba: np.ndarray | None) -> None:
        """Lay a label map uint8 [H, W, 4] above everything, at its own opacity; None takes it away."""
        if rgba is not None or self._stack.labels is not None:
            self._stack.set_labels(rgba)
            self.update()

    def patch_labels(self, rgba: np.ndarray, left: int, top: int) -> None:
        """Replace a part, uint8 [h, w, 4], of the label map that is shown."""
        self._stack.patch_labels(rgba, left, top)
        self.update()

    def set_observed(self, rgb: np.ndarray | None) -> None:
        """The clip's own frame, uint8 [H, W, 3], to compare with."""
        self._stack.set_observed(rgb)
        self.update()

    def set_compare_mode(self, mode: str) -> None:
        if mode not in COMPARE_MODES:
            raise ValueError(f"unknown comparison {mode!r}; there are {', '.join(COMPARE_MODES)}")
        if mode != self._stack.mode:
            self._stack.mode, self._stack.blinked = mode, False
            self._blinking.start() if mode == "blink" else self._blinking.stop()
        self.update()

    def compare_mode(self) -> str:
        return self._stack.mode

    def _blink(self) -> None:
        self._stack.blinked = not self._stack.blinked
        self.update()

    def set_split(self, split: float) -> None:
        """Place the wipe line: the image left of this fraction of its width, the observed frame right of it."""
        self._stack.split = min(max(split, 0.0), 1.0)
        self.update()

    def split(self) -> float:
        return self._stack.split

    def set_difference_gain(self, gain: float) -> None:
        """Differences are shown `gain` times as bright as they are."""
        self._stack.set_gain(gain)
        self.update()

    def set_tool(self, tool: PanelTool | None) -> None:
        """Put a tool into the hand, which then owns the left button; None: the left button pans and clicks again."""
        self._tool, self._using_tool = tool, False
        self._update_cursor(self._last)
        self.update()

    def tool(self) -> PanelTool | None:
        return self._tool

    def set_outline(self, outline: Sequence[tuple[float, float]]) -> None:
        """Outline a region: corners (x, y) in image pixels; empty for none."""
        shape = QPolygonF([QPointF(x, y) for x, y in outline])
        if shape != self._outline:
            self._outline = shape
            self.update()

    def set_marker(self, x: float, y: float) -> None:
        self._marker = QPointF(x, y)
        self.update()

    def clear_marker(self) -> None:
        if self._marker is not None:
            self._marker = None
            self.update()

    def set_legend(self, entries: Sequence[tuple[str, QColor]]) -> None:
        self._legend = list(entries)
        self.update()

    def grab_image(self) -> np.ndarray:
        """What is shown, uint8 [H, W, 3], at the picture's own resolution, without marker and legend."""
        return self._stack.grab()

    # Zoom

    def zoom(self) -> float:
        """Screen pixels an image pixel."""
        return self._look.scale * self.devicePixelRatioF()

    def view(self) -> tuple[float, float, float]:
        """Widget pixels an image pixel, and the image point in the middle of the panel: what another panel needs to look alike."""
        return self._look.view()

    def set_view(self, scale: float, x: float, y: float) -> None:
        """Look as another panel does. Tells nobody."""
        self._look.set_view(scale, x, y)
        self.update()

    def is_whole(self) -> bool:
        """Whether the whole picture is shown, whatever the size of the panel."""
        return self._look.fitted

    def fit(self) -> None:
        """Show the whole picture, and keep doing so when the panel is resized."""
        self._fit()
        self.update()

    def set_zoom(self, scale: float, about: QPointF | None = None) -> None:
        """Zoom to `scale` screen pixels an image pixel; what lies under `about` (widget position, default: centre) stays there."""
        about = about if about is not None else QRectF(self.rect()).center()
        self._look.zoom_to(min(max(scale, MIN_ZOOM), MAX_ZOOM) / self.devicePixelRatioF(), about)
        self._moved()

    def _fit(self) -> None:
        self._look.fit()
        self.zoom_changed.emit(self.zoom())

    def _moved(self) -> None:
        self.zoom_changed.emit(self.zoom())
        self.update()

    def _split_x(self) -> float:
        target = self._look.target()
        return target.left() + self._stack.split * target.width()

    # Painting

    def paintEvent(self, event: QPaintEvent) -> None:
        with QPainter(self) as painter:  # ended even when painting fails; Qt crashes on a painter left open
            self._paint(painter)

    def _paint(self, painter: QPainter) -> None:
        painter.fillRect(self.rect(), picture_background(self.palette()))
        if self._stack.image is None:
            painter.setPen(self.palette().color(QPalette.ColorRole.PlaceholderText))
            painter.drawText(
                self.rect().adjusted(24, 24, -24, -24), Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap.value, self._message
            )
            return
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, self.zoom() < NEAREST_FROM)
        self._stack.paint(painter, self._look.target())
        self._paint_marks(painter)
        if self.hasFocus():
            painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Accent), 1))
            painter.drawRect(self.rect().adjusted(0, 0, -1, -1))

    def _paint_marks(self, painter: QPainter) -> None:
        stack = self._stack
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if self._tool is not None or not self._outline.isEmpty():
            painter.save()
            painter.translate(self._look.origin)
            painter.scale(self._look.scale, self._look.scale)
            if not self._outline.isEmpty():
                paint_outline(painter, self._outline, self._look.scale)
            if self._tool is not None:
                self._tool.paint(painter, self._look.scale)
            painter.restore()
        if stack.compares("wipe"):
            paint_wipe_handle(painter, self._split_x(), self._look.target().intersected(QRectF(self.rect())))
        if self._marker is not None:
            paint_cross(painter, self._look.to_widget(self._marker))
        if self._legend:
            paint_legend(painter, QPointF(8, self.height() - 8), self._legend, self.width() - 16)
        if words := "  ·  ".join(filter(None, (self._title, self._compare_words()))):
            paint_tag(painter, QPointF(8, 8), words)

    def _compare_words(self) -> str:
        if self._stack.mode == "off":
            return ""
        if self._stack.observed is None:
            return "no observed frame to compare with"
        if self._stack.mode == "blink":
            return "observed" if self._stack.blinked else "reconstruction"
        return f"difference × {self._stack.gain:g}" if self._stack.mode == "difference" else ""

    # Events

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._press = self._last = event.position()
        self._panning = False
        left = event.button() == Qt.MouseButton.LeftButton
        self._splitting = left and self._on_handle(event.position())
        if left and not self._splitting and self._tool is not None and self._stack.image is not None:
            self._using_tool = True
            self._tool.press(self._look.to_image(event.position()), event)
            self.update()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._tool is not None and (self._using_tool or not event.buttons()):
            self._tool.move(self._look.to_image(event.position()), event)
            self.update()
        elif self._press is not None and event.buttons():
            if self._splitting:
                self._user_split((event.position().x() - self._look.target().left()) / self._look.target().width())
            elif self._panning or (event.position() - self._press).manhattanLength() > CLICK_SLACK:
                self._panning = True
                self._look.move(event.position() - self._last)
                self._moved()
        self._last = event.position()
        self._update_cursor(event.position())
        self._hover(event.position().toPoint())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._using_tool and self._tool is not None and event.button() == Qt.MouseButton.LeftButton:
            self._using_tool, self._press = False, None
            self._tool.release(self._look.to_image(event.position()), event)
            self.update()
            return
        click = self._press is not None and not self._panning and not self._splitting and event.button() == Qt.MouseButton.LeftButton
        self._press = None
        self._panning = self._splitting = False
        point = self._pixel(event.position())
        if click and point is not None:
            self.clicked.emit(*point)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if self._tool is not None:
            self.mousePressEvent(event)
        elif not self._on_handle(event.position()):
            self.fit()

    def wheelEvent(self, event: QWheelEvent) -> None:
        if self._stack.image is not None and event.angleDelta().y():
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
            case Qt.Key.Key_BracketLeft if self._stack.mode == "wipe":
                self._user_split(self._stack.split - step)
            case Qt.Key.Key_BracketRight if self._stack.mode == "wipe":
                self._user_split(self._stack.split + step)
            case _:
                super().keyPressEvent(event)

    def leaveEvent(self, event: QEvent) -> None:
        self._hover(QPoint(-1, -1))

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._look.resize(QSizeF(event.size()))
        self.zoom_changed.emit(self.zoom())

    def focusInEvent(self, event: QEvent) -> None:
        self.update()

    def focusOutEvent(self, event: QEvent) -> None:
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(640, 512)

    def _on_handle(self, position: QPointF) -> bool:
        return self._stack.compares("wipe") and abs(position.x() - self._split_x()) <= GRIP

    def _user_split(self, split: float) -> None:
        self.set_split(split)
        self.split_changed.emit(self._stack.split)

    def _update_cursor(self, position: QPointF) -> None:
        if self._splitting or self._on_handle(position):
            self.setCursor(Qt.CursorShape.SplitHCursor)
        elif self._panning:
            self.setCursor(Qt.CursorShape.ClosedHandCursor)
        elif self._stack.image is None:
            self.setCursor(Qt.CursorShape.ArrowCursor)
        else:
            self.setCursor(self._tool.cursor if self._tool is not None else Qt.CursorShape.CrossCursor)

    def _pixel(self, position: QPointF) -> tuple[int, int] | None:
        if self._stack.image is None or not QRectF(self.rect()).contains(position):
            return None
        point = self._look.to_image(position)
        x, y = int(np.floor(point.x())), int(np.floor(point.y()))
        return (x, y) if 0 <= x < self._look.image[0] and 0 <= y < self._look.image[1] else None

    def _hover(self, position: QPoint) -> None:
        pixel = self._pixel(QPointF(position))
        if pixel is not None or self._inside:
            self.hovered.emit(*(pixel or (-1, -1)))
        self._inside = pixel is not None
