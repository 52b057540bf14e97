"""The 2D view: one frame with overlays, comparison, marks, zoom and tools."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QEvent, QPoint, QPointF, QRectF, QSize, QSizeF, Qt, Signal
from PySide6.QtGui import QImage, QKeyEvent, QMouseEvent, QPainter, QPalette, QPen, QResizeEvent, QStatusTipEvent, QWheelEvent
from PySide6.QtWidgets import QApplication, QSizePolicy, QWidget

from degense.widgets.forms import PaintedWidget
from degense.widgets.frame.frame_comparison import Comparison
from degense.widgets.frame.panel_marks import PanelMarks, paint_outline, paint_wipe_handle
from degense.widgets.frame.panel_tools import PanelTool
from degense.widgets.frame.panel_zoom import PanelZoom
from degense.widgets.keys import keep_keys
from degense.widgets.qt_images import DrawableFrame, to_array, to_qimage
from degense.widgets.theme import frame_background

#: From this zoom on (screen pixels an image pixel) pixels are drawn as squares.
NEAREST_FROM = 3.0

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


class RenderPanel(PaintedWidget):
    """Shows one frame, a mask overlay above it, and a label map above both."""

    tool_chosen = Signal()
    hovered = Signal(int, int)  # (x, y) pixels of the image; (-1, -1) when the pointer leaves it
    clicked = Signal(int, int)  # (x, y) pixels of the image

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Frame")
        self.setAccessibleDescription("Wheel zooms, drag pans, 0 fits, 1 shows pixels one to one, square brackets move the wipe line")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        keep_keys(self, _KEYS)
        self.setMouseTracking(True)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self.zoom, self.comparison, self.marks = PanelZoom(self), Comparison(self), PanelMarks(self)
        self._frame: DrawableFrame | None = None
        self._overlay: QImage | None = None
        self._overlay_opacity = 1.0
        self._labels: QImage | None = None
        self._message = "Nothing to show yet"
        self.tool: PanelTool | None = None
        self.click_hint = ""  # what a click does without a tool
        self._using_tool = False
        self._press: QPointF | None = None
        self._last = QPointF()
        self._panning = self._splitting = False
        self._inside = False
        self.show_hint()

    # What is shown

    def set_image(self, rgb: np.ndarray | None) -> None:
        """Show a frame, uint8 [H, W, 3], or with None the message."""
        self._frame = DrawableFrame.of(rgb)
        if rgb is not None:
            self.zoom.set_image(rgb.shape[1], rgb.shape[0])
        self.update()

    def set_message(self, text: str) -> None:
        """The text that is shown without a frame."""
        self._message = text
        self.update()

    def set_overlay(self, rgba: np.ndarray | None) -> None:
        """Lay uint8 [H, W, 4] (any size; stretched over the frame) on top."""
        self._overlay = None if rgba is None else to_qimage(rgba)
        self.update()

    def set_overlay_opacity(self, opacity: float) -> None:
        self._overlay_opacity = min(max(opacity, 0.0), 1.0)
        self.update()

    def set_labels(self, rgba: np.ndarray | None) -> None:
        """Lay a label map uint8 [H, W, 4] above everything, at its own opacity; None removes it."""
        if rgba is not None or self._labels is not None:
            self._labels = None if rgba is None else to_qimage(rgba)
            self.update()

    def patch_labels(self, rgba: np.ndarray, left: int, top: int) -> None:
        """Replace a part, uint8 [h, w, 4], of the label map that is shown."""
        if self._labels is not None:
            with QPainter(self._labels) as painter:
                painter.setCompositionMode(QPainter.CompositionMode.CompositionMode_Source)
                painter.drawImage(left, top, to_qimage(rgba))
        self.update()

    def set_tool(self, tool: PanelTool | None) -> None:
        """Activate a tool, which then owns the left button; None: the left button pans and clicks again."""
        self.tool, self._using_tool = tool, False
        self.show_hint(chosen=tool is not None)
        if tool is not None:
            self.tool_chosen.emit()
        self._update_cursor(self._last)
        self.update()

    def show_hint(self, chosen: bool = False) -> None:
        """Say in the status bar what the mouse does here: while it is here, or where it is wanted because a tool was chosen."""
        moves = "drag: move" if self.tool is None else "right button: move"
        hint = self.click_hint if self.tool is None else self.tool.hint
        tip = " · ".join(filter(None, (hint, moves, "wheel: zoom", "double click: fit" if self.tool is None else "")))
        self.setStatusTip(tip)
        if chosen or self.underMouse():
            QApplication.sendEvent(self, QStatusTipEvent(tip))

    def grab_image(self) -> np.ndarray:
        """What is shown, uint8 [H, W, 3], at the frame's own resolution, without marks. ValueError without a frame."""
        if self._frame is None:
            raise ValueError("there is no frame to grab")
        canvas = QImage(self._frame.drawn.size(), QImage.Format.Format_RGB32)
        with QPainter(canvas) as painter:
            self._paint_frame(painter, self._frame, QRectF(canvas.rect()))
        return to_array(canvas)

    # Painting

    def _paint(self, painter: QPainter) -> None:
        painter.fillRect(self.rect(), frame_background(self.palette()))
        if self._frame is None:
            painter.setPen(self.palette().color(QPalette.ColorRole.PlaceholderText))
            flags = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap.value
            painter.drawText(self.rect().adjusted(24, 24, -24, -24), flags, self._message)
            return
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, self.zoom.factor() < NEAREST_FROM)
        self._paint_frame(painter, self._frame, self.zoom.target())
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._paint_region(painter)
        if self._wipes():
            paint_wipe_handle(painter, self._split_x(), self.zoom.target().intersected(QRectF(self.rect())))
        self.marks.paint(painter, self.zoom, self.comparison.note())
        if self.hasFocus():
            painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Accent), 1))
            painter.drawRect(self.rect().adjusted(0, 0, -1, -1))

    def _paint_frame(self, painter: QPainter, frame: DrawableFrame, target: QRectF) -> None:
        """Paint frame, overlay, labels and comparison into `target`."""
        if self.comparison.paint_alone(painter, target):
            return
        painter.drawImage(target, self.comparison.base(frame))
        if self._overlay is not None and self._overlay_opacity > 0:
            painter.setOpacity(self._overlay_opacity)
            painter.drawImage(target, self._overlay)
            painter.setOpacity(1.0)
        if self._labels is not None:
            painter.drawImage(target, self._labels)
        self.comparison.paint_wiped(painter, target)

    def _paint_region(self, painter: QPainter) -> None:
        """Paint the outline and the tool in image pixels."""
        painter.save()
        painter.translate(self.zoom.origin)
        painter.scale(self.zoom.scale, self.zoom.scale)
        if not self.marks.outline.isEmpty():
            paint_outline(painter, self.marks.outline, self.zoom.scale)
        if self.tool is not None:
            self.tool.paint(painter, self.zoom.scale)
        painter.restore()

    # Events

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._press = self._last = event.position()
        self._panning = False
        left = event.button() == Qt.MouseButton.LeftButton
        self._splitting = left and self._on_handle(event.position())
        if left and not self._splitting and self.tool is not None and self._frame is not None:
            self._using_tool = True
            self.tool.press(self.zoom.to_image(event.position()), event)
            self.update()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self.tool is not None and self._using_tool and not event.buttons() & Qt.MouseButton.LeftButton:
            self._using_tool = False  # the button went up over another window
            self.tool.release(self.zoom.to_image(self._last), event)
        if self.tool is not None and (self._using_tool or not event.buttons()):
            self.tool.move(self.zoom.to_image(event.position()), event)
            self.update()
        elif self._press is not None and event.buttons():
            if self._splitting:
                target = self.zoom.target()
                self.comparison.set_split((event.position().x() - target.left()) / target.width())
            elif self._panning or (event.position() - self._press).manhattanLength() > CLICK_SLACK:
                self._panning = True
                self.zoom.move(event.position() - self._last)
        self._last = event.position()
        self._update_cursor(event.position())
        self._hover(event.position().toPoint())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._using_tool and self.tool is not None and event.button() == Qt.MouseButton.LeftButton:
            self._using_tool, self._press = False, None
            self.tool.release(self.zoom.to_image(event.position()), event)
            self.update()
            return
        click = self._press is not None and not self._panning and not self._splitting and event.button() == Qt.MouseButton.LeftButton
        self._press = None
        self._panning = self._splitting = False
        point = self._pixel(event.position())
        if click and point is not None:
            self.clicked.emit(*point)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if self.tool is not None:
            self.mousePressEvent(event)
        elif not self._on_handle(event.position()):
            self.zoom.fit()

    def wheelEvent(self, event: QWheelEvent) -> None:
        if self._frame is not None and event.angleDelta().y():
            self.zoom.set_factor(self.zoom.factor() * 1.2 ** (event.angleDelta().y() / 120.0), event.position())
            event.accept()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        zoom, comparison = self.zoom, self.comparison
        step = 0.1 if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 0.02
        match event.key():
            case Qt.Key.Key_Plus | Qt.Key.Key_Equal:
                zoom.set_factor(zoom.factor() * 1.25)
            case Qt.Key.Key_Minus:
                zoom.set_factor(zoom.factor() / 1.25)
            case Qt.Key.Key_0:
                zoom.fit()
            case Qt.Key.Key_1:
                zoom.set_factor(1.0)
            case Qt.Key.Key_BracketLeft if comparison.mode == "wipe":
                comparison.set_split(comparison.split - step)
            case Qt.Key.Key_BracketRight if comparison.mode == "wipe":
                comparison.set_split(comparison.split + step)
            case _:
                super().keyPressEvent(event)

    def leaveEvent(self, event: QEvent) -> None:
        self._hover(QPoint(-1, -1))

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.zoom.resize(QSizeF(event.size()))

    def focusInEvent(self, event: QEvent) -> None:
        self.update()

    focusOutEvent = focusInEvent

    def sizeHint(self) -> QSize:
        return QSize(640, 512)

    # Inside

    def _wipes(self) -> bool:
        return self._frame is not None and self.comparison.shows("wipe")

    def _split_x(self) -> float:
        target = self.zoom.target()
        return target.left() + self.comparison.split * target.width()

    def _on_handle(self, position: QPointF) -> bool:
        return self._wipes() and abs(position.x() - self._split_x()) <= GRIP

    def _update_cursor(self, position: QPointF) -> None:
        if self._splitting or self._on_handle(position):
            self.setCursor(Qt.CursorShape.SplitHCursor)
        elif self._panning:
            self.setCursor(Qt.CursorShape.ClosedHandCursor)
        elif self._frame is None:
            self.setCursor(Qt.CursorShape.ArrowCursor)
        else:
            self.setCursor(self.tool.cursor if self.tool is not None else Qt.CursorShape.CrossCursor)

    def _pixel(self, position: QPointF) -> tuple[int, int] | None:
        if self._frame is None or not QRectF(self.rect()).contains(position):
            return None
        point = self.zoom.to_image(position)
        x, y = int(np.floor(point.x())), int(np.floor(point.y()))
        return (x, y) if 0 <= x < self.zoom.image[0] and 0 <= y < self.zoom.image[1] else None

    def _hover(self, position: QPoint) -> None:
        pixel = self._pixel(QPointF(position))
        if pixel is not None or self._inside:
            self.hovered.emit(*(pixel or (-1, -1)))
        self._inside = pixel is not None
