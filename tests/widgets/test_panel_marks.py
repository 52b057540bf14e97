"""Marks over a frame, as they are painted."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QColor, QImage, QPainter

from degense.widgets.frame.panel_marks import paint_legend


@pytest.mark.parametrize("room", [120, 200, 900])
def test_a_legend_goes_on_in_another_line_where_there_is_no_room(room, qapp):
    """All words are painted, inside of the width, and no entry over another."""
    drawn: list[tuple[QRectF, str]] = []

    class Painter(QPainter):
        def drawText(self, place, flags, text) -> None:
            drawn.append((place, text))

    words = ("gallbladder", "hatched: a guess, since its motion is not seen well")
    canvas = QImage(1000, 400, QImage.Format.Format_RGB32)
    with Painter(canvas) as painter:
        paint_legend(painter, QPointF(0, 400), [(text, QColor("red")) for text in words], room)
        needed = painter.fontMetrics().boundingRect(words[1])
    (upper, first), (lower, second) = drawn
    assert (first, second) == words
    assert upper.bottom() <= lower.top()
    assert lower.right() <= room
    assert lower.bottom() <= 400
    assert (lower.height() >= 2 * needed.height() - 4) == (room < needed.width())
