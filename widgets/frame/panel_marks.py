"""Marks over a frame: title, legend, marker, outline and wipe handle. White on a dark background, legible on any tissue."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from PySide6.QtCore import QObject, QPointF, QRect, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from degense.widgets.frame.panel_zoom import PanelZoom

_INK, _VEIL = QColor(255, 255, 255), QColor(0, 0, 0, 150)


class PanelMarks(QObject):
    """What is painted over the frame of a panel, and not saved with it. Positions are pixels of the image."""

    def __init__(self, panel: QWidget) -> None:
        super().__init__(panel)
        self._panel = panel
        self._title = ""
        self._marker: QPointF | None = None
        self._legend: list[tuple[str, QColor]] = []
        self.painters: list[Callable[[QPainter, PanelZoom], None]] = []  # marks that features paint themselves
        self.outline = QPolygonF()  # of a region; empty for none. The panel paints it with its tool

    def set_title(self, text: str) -> None:
        """A name in the corner, to tell two panels apart; empty for none."""
        self._title = text
        self._panel.update()

    def set_marker(self, at: tuple[float, float] | None) -> None:
        """A cross at (x, y), or none."""
        self._marker = None if at is None else QPointF(*at)
        self._panel.update()

    def set_outline(self, outline: Sequence[tuple[float, float]]) -> None:
        """Outline a region: corners (x, y); empty for none."""
        shape = QPolygonF([QPointF(x, y) for x, y in outline])
        if shape != self.outline:
            self.outline = shape
            self._panel.update()

    def set_legend(self, entries: Sequence[tuple[str, QColor]]) -> None:
        """Names with their colours; empty for none."""
        self._legend = list(entries)
        self._panel.update()

    def paint(self, painter: QPainter, zoom: PanelZoom, note: str) -> None:
        """Paint all but the outline; `note` follows the title."""
        for paint in self.painters:
            paint(painter, zoom)
        if self._marker is not None:
            paint_cross(painter, zoom.to_widget(self._marker))
        if self._legend:
            children = self._panel.findChildren(QWidget, options=Qt.FindChildOption.FindDirectChildrenOnly)
            taken = [child.geometry() for child in children if child.isVisible()]
            paint_legend(painter, QPointF(8, self._panel.height() - 8), self._legend, self._panel.width() - 16, taken)
        if text := "  ·  ".join(filter(None, (self._title, note))):
            paint_tag(painter, QPointF(8, 8), text)


def paint_outline(painter: QPainter, outline: QPolygonF, scale: float, closed: bool = True) -> None:
    """A line that is seen on any tissue, white on black, in a painter that works in image pixels of `scale` widget pixels."""
    painter.setBrush(Qt.BrushStyle.NoBrush)
    for colour, width in ((QColor(0, 0, 0, 180), 3.0), (_INK, 1.4)):
        painter.setPen(QPen(colour, width / scale, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin))
        painter.drawPolygon(outline) if closed else painter.drawPolyline(outline)


def _veil(painter: QPainter, box: QRectF) -> None:
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(_VEIL)
    painter.drawRoundedRect(box, 4, 4)
    painter.setBrush(Qt.BrushStyle.NoBrush)


def paint_tag(painter: QPainter, corner: QPointF, text: str, right_aligned: bool = False) -> None:
    """A few words on a dark box, whose upper left (or right) corner is `corner`."""
    metrics = painter.fontMetrics()
    width, height = metrics.horizontalAdvance(text) + 12, metrics.height() + 4
    box = QRectF(corner.x() - (width if right_aligned else 0), corner.y(), width, height)
    _veil(painter, box)
    painter.setPen(_INK)
    painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)


def paint_legend(
    painter: QPainter, corner: QPointF, entries: Sequence[tuple[str, QColor]], widest: float, taken: Sequence[QRect] = ()
) -> None:
    """Names with their colours; `corner` is the lower left one. Names that need more room than `widest` go on in another line.

    What would reach into the places that are `taken`, or above the picture, is left out, and its number said.
    """
    metrics = painter.fontMetrics()
    row, swatch = metrics.height() + 4, metrics.ascent()
    flags = int(Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft | Qt.TextFlag.TextWordWrap)
    room = QRect(0, 0, max(round(widest) - swatch - 22, 20), round(corner.y()))
    for count in range(len(entries), -1, -1):
        names = [name for name, _ in entries[:count]] + ([f"and {len(entries) - count} more"] if count < len(entries) else [])
        sizes = [metrics.boundingRect(room, flags, name).size() for name in names]
        height = sum(size.height() + 4 for size in sizes) + 6
        box = QRectF(corner.x(), corner.y() - height, max(size.width() for size in sizes) + swatch + 22, height)
        if box.top() >= 0 and not any(box.intersects(QRectF(place)) for place in taken):
            break
    else:
        return
    _veil(painter, box)
    y = box.top() + 3
    for index, (name, size) in enumerate(zip(names, sizes, strict=True)):
        if index < count:
            painter.setPen(Qt.PenStyle.NoPen)
            painter.setBrush(entries[index][1])
            painter.drawRoundedRect(QRectF(box.left() + 7, y + (row - swatch) / 2, swatch, swatch), 2, 2)
        painter.setPen(_INK)
        painter.drawText(QRectF(box.left() + swatch + 14, y + 2, size.width() + 1, size.height()), flags, name)
        y += size.height() + 4
    painter.setBrush(Qt.BrushStyle.NoBrush)


def paint_cross(painter: QPainter, at: QPointF) -> None:
    """Four strokes around a point, which itself stays free."""
    for colour, width in ((QColor(0, 0, 0, 180), 3.2), (_INK, 1.4)):
        painter.setPen(QPen(colour, width))
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            painter.drawLine(at + QPointF(4 * dx, 4 * dy), at + QPointF(11 * dx, 11 * dy))


def paint_wipe_handle(painter: QPainter, x: float, area: QRectF) -> None:
    """The line between reconstruction (left) and observed frame (right), with a knob in the middle of `area`."""
    for colour, width in ((QColor(0, 0, 0, 140), 3.0), (QColor(255, 255, 255, 230), 1.2)):
        painter.setPen(QPen(colour, width))
        painter.drawLine(QPointF(x, area.top()), QPointF(x, area.bottom()))
    middle = QPointF(x, area.center().y())
    painter.setPen(QPen(QColor(0, 0, 0, 160), 1))
    painter.setBrush(QColor(255, 255, 255, 230))
    painter.drawEllipse(middle, 9, 9)
    painter.setBrush(Qt.BrushStyle.NoBrush)
    painter.setPen(QPen(QColor(40, 40, 40), 1.6))
    for side in (-1, 1):
        painter.drawPolyline([middle + QPointF(side * 2.5, -3.5), middle + QPointF(side * 6, 0), middle + QPointF(side * 2.5, 3.5)])
    paint_tag(painter, QPointF(x - 12, area.top() + 8), "reconstruction", right_aligned=True)
    paint_tag(painter, QPointF(x + 12, area.top() + 8), "observed")
