"""A frame on which the places of burnt-in text are marked with rectangles."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPointF, QRect, QRectF, QSize, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPen
from PySide6.QtWidgets import QLabel, QPushButton, QWidget

from degense.widgets import forms
from degense.widgets.qt_images import to_qimage
from degense.widgets.theme import frame_background

#: Left, top, width and height of what is blacked out, pixels of the clip.
Rectangle = tuple[int, int, int, int]
_DRAWN = QColor(0, 0, 0)
_EDGE = QColor(255, 200, 0)


def cover_of(rectangles: list[Rectangle], size: tuple[int, int]) -> np.ndarray | None:
    """The pixels of rectangles, bool [H, W], of a clip's (width, height); None without any."""
    cover = np.zeros(size[::-1], bool)
    for left, top, width, height in rectangles:
        cover[top : top + height, left : left + width] = True
    return cover if cover.any() else None


class CoverDrawing(forms.PaintedWidget):
    """The frame, uint8 [H, W, 3], and black rectangles over it; dragging adds one."""

    added = Signal(tuple)  # (rectangle)

    def __init__(self, frame: np.ndarray) -> None:
        super().__init__()
        forms.named(self, "Frame with what is blacked out", "Drag over what is burnt into the picture")
        self.rectangles: list[Rectangle] = []
        self._frame = to_qimage(frame)
        self._from: QPointF | None = None
        self._to = QPointF()
        self.setMinimumSize(320, 240)

    def sizeHint(self) -> QSize:
        return QSize(720, 480)

    def _place(self) -> QRectF:
        """Where the frame is drawn: whole, in the middle."""
        size = self._frame.size()
        scale = min(self.width() / size.width(), self.height() / size.height())
        width, height = scale * size.width(), scale * size.height()
        return QRectF((self.width() - width) / 2, (self.height() - height) / 2, width, height)

    def to_pixels(self, where: QPointF) -> QPointF:
        """A place of the widget in pixels of the frame, at its border when it is outside."""
        place, size = self._place(), self._frame.size()
        x = (where.x() - place.x()) / place.width() * size.width()
        y = (where.y() - place.y()) / place.height() * size.height()
        return QPointF(min(max(x, 0.0), size.width()), min(max(y, 0.0), size.height()))

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._from = self._to = self.to_pixels(event.position())

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self._to = self.to_pixels(event.position())
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        if self._from is not None:
            drawn = QRectF(self._from, self.to_pixels(event.position())).normalized().toAlignedRect()
            self._from = None
            self.update()
            if drawn.width() > 1 and drawn.height() > 1:
                self.added.emit((drawn.x(), drawn.y(), drawn.width(), drawn.height()))

    def _paint(self, painter: QPainter) -> None:
        place = self._place()
        painter.fillRect(self.rect(), frame_background(self.palette()))
        painter.drawImage(place, self._frame)
        scale = place.width() / self._frame.width()
        painter.translate(place.topLeft())
        painter.scale(scale, scale)
        painter.setPen(QPen(_EDGE, 0))  # a line of one pixel of the screen
        painter.setBrush(_DRAWN)
        for rectangle in self.rectangles:
            painter.drawRect(QRect(*rectangle))
        if self._from is not None:
            painter.drawRect(QRectF(self._from, self._to).normalized())


class CoverDialog(forms.Dialog):
    """Rectangles by dragging, or by their numbers; `drawn` tells them when they are taken."""

    drawn = Signal(list)

    def __init__(self, parent: QWidget, frame: np.ndarray, rectangles: list[Rectangle]) -> None:
        super().__init__(parent, "cover", "Black out burnt-in text", 760, 600)
        height, width = frame.shape[:2]
        self.drawing = CoverDrawing(frame)
        self.drawing.rectangles = list(rectangles)
        self.drawing.added.connect(self.add)
        names = (("Left", width - 1), ("Top", height - 1), ("Width", width), ("Height", height))
        self.numbers = [forms.number(name, 0 if name in ("Left", "Top") else 1, most) for name, most in names]
        fields = [item for (name, _), number in zip(names, self.numbers, strict=True) for item in (QLabel(name), number)]
        add = forms.button("Add", self._add_numbers, "Black out the rectangle of these numbers")
        self.back = forms.button("Remove last", self.remove_last)
        self.sentence = forms.label(name="What is blacked out", secondary=True)
        buttons = self.closing()
        take = QPushButton("Use this")
        take.setDefault(True)
        take.clicked.connect(self._take)
        buttons.addButton(take, buttons.ButtonRole.ActionRole)
        hint = forms.label("Drag over each text that is burnt into the picture, or give its place in pixels.")
        forms.column(hint, (self.drawing, 1), forms.row(*fields, add, 0, self.back), self.sentence, buttons, margin=12, parent=self)
        self._show()

    def add(self, rectangle: Rectangle) -> None:
        self.drawing.rectangles.append(rectangle)
        self._show()

    def _add_numbers(self) -> None:
        left, top, width, height = (number.value() for number in self.numbers)
        self.add((left, top, width, height))

    def remove_last(self) -> None:
        del self.drawing.rectangles[-1:]
        self._show()

    def _show(self) -> None:
        count = len(self.drawing.rectangles)
        self.sentence.setText(f"{count} rectangle{'' if count == 1 else 's'}, black in every frame.")
        self.back.setEnabled(count > 0)
        self.drawing.update()

    def _take(self) -> None:
        self.drawn.emit(list(self.drawing.rectangles))
        self.accept()
