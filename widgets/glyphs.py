"""Small buttons whose glyphs are drawn in the palette's text colour: right in every theme and at every resolution."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QPainter, QPainterPath, QPaintEvent, QPalette, QPen, QPolygonF
from PySide6.QtWidgets import QToolButton, QWidget

from degense.widgets.keys import PRESS, keep_keys


def _polygon(*points: tuple[float, float]) -> QPainterPath:
    path = QPainterPath()
    path.addPolygon(QPolygonF([QPointF(x, y) for x, y in points]))
    path.closeSubpath()
    return path


def _bar(x: float, y: float, width: float, height: float) -> QPainterPath:
    path = QPainterPath()
    path.addRect(QRectF(x, y, width, height))
    return path


def _lines(*lines: tuple[tuple[float, float], ...]) -> QPainterPath:
    path = QPainterPath()
    for first, *rest in lines:
        path.moveTo(*first)
        for point in rest:
            path.lineTo(*point)
    return path


def _eye(open_: bool) -> QPainterPath:
    path = QPainterPath()
    path.moveTo(1.5, 8)
    path.quadTo(8, 0.5, 14.5, 8)
    path.quadTo(8, 15.5, 1.5, 8)
    path.addEllipse(QPointF(8, 8), 2.2, 2.2)
    if not open_:
        path.addPath(_lines(((2.5, 13.5), (13.5, 2.5))))
    return path


#: name → (path in a 16 × 16 box, filled?)
_GLYPHS = {
    "play": (_polygon((4, 2), (14, 8), (4, 14)), True),
    "pause": (_bar(3.5, 2.5, 3.2, 11).united(_bar(9.3, 2.5, 3.2, 11)), True),
    "next": (_polygon((3, 3), (10, 8), (3, 13)).united(_bar(11, 3, 2, 10)), True),
    "previous": (_polygon((13, 3), (6, 8), (13, 13)).united(_bar(3, 3, 2, 10)), True),
    "first": (_polygon((9.5, 3), (4.5, 8), (9.5, 13)).united(_polygon((15, 3), (10, 8), (15, 13))).united(_bar(1.5, 3, 2, 10)), True),
    "last": (_polygon((6.5, 3), (11.5, 8), (6.5, 13)).united(_polygon((1, 3), (6, 8), (1, 13))).united(_bar(12.5, 3, 2, 10)), True),
    "cross": (_lines(((4, 4), (12, 12)), ((12, 4), (4, 12))), False),
    "up": (_lines(((3, 10), (8, 5), (13, 10))), False),
    "down": (_lines(((3, 6), (8, 11), (13, 6))), False),
    "plus": (_lines(((8, 3), (8, 13)), ((3, 8), (13, 8))), False),
    "minus": (_lines(((3, 8), (13, 8))), False),
    "eye": (_eye(True), False),
    "eye-off": (_eye(False), False),
}


class GlyphButton(QToolButton):
    """A tool button with one of the glyphs above.

    Parameters
    ----------
    glyph : str
    name : str
        What it does: accessible name and tooltip.
    """

    def __init__(self, glyph: str, name: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAutoRaise(True)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        keep_keys(self, PRESS)
        self.set_glyph(glyph, name)

    def set_glyph(self, glyph: str, name: str) -> None:
        self._path, self._filled = _GLYPHS[glyph]
        self.setAccessibleName(name)
        self.setToolTip(name)
        self.update()

    def sizeHint(self) -> QSize:
        side = max(24, self.fontMetrics().height() + 10)
        return QSize(side, side)

    minimumSizeHint = sizeHint

    def paintEvent(self, event: QPaintEvent) -> None:
        super().paintEvent(event)
        with QPainter(self) as painter:  # ended even when painting fails; Qt crashes on a painter left open
            self._paint(painter)

    def _paint(self, painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        group = QPalette.ColorGroup.Active if self.isEnabled() else QPalette.ColorGroup.Disabled
        colour = self.palette().color(group, QPalette.ColorRole.ButtonText)
        scale = 0.58 * min(self.width(), self.height()) / 16
        painter.translate(self.width() / 2, self.height() / 2)
        painter.scale(scale, scale)
        painter.translate(-8, -8)
        if self._filled:
            painter.fillPath(self._path, colour)
        else:
            painter.strokePath(self._path, QPen(colour, 1.6, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap))
