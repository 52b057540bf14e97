"""Marks over a frame, as they are painted."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPointF, QRect, QRectF
from PySide6.QtGui import QColor, QFontMetrics, QImage, QPainter
from PySide6.QtWidgets import QApplication

from degense.widgets.frame.panel_marks import paint_legend


def painted(height: int, *arguments) -> list[tuple[QRectF, str]]:
    """The words of a legend with their places, on a canvas of 1000 × height."""
    drawn: list[tuple[QRectF, str]] = []

    class Painter(QPainter):
        def drawText(self, place, flags, text) -> None:
            drawn.append((place, text))

    canvas = QImage(1000, height, QImage.Format.Format_RGB32)
    with Painter(canvas) as painter:
        paint_legend(painter, QPointF(0, height), *arguments)
    return drawn


def test_a_legend_leaves_the_colour_bar_free(qapp):
    """Entries that would lie under it are left out and counted; beside it there is room for all."""
    entries = [(f"organ {k}", QColor("red")) for k in range(9)]
    bar = QRect(0, 0, 1000, 60)
    drawn = painted(200, entries, 900, [bar])
    shown = [text for _, text in drawn]
    assert 1 < len(shown) < 9
    assert shown == [f"organ {k}" for k in range(len(shown) - 1)] + [f"and {10 - len(shown)} more"]
    assert all(place.top() > bar.bottom() for place, _ in drawn)
    assert len(painted(400, entries, 900, [bar.translated(500, 0)])) == 9
    assert not painted(60, entries, 900, [bar])


@pytest.mark.parametrize("room", [120, 200, 900])
def test_a_legend_goes_on_in_another_line_where_there_is_no_room(room, qapp):
    """All words are painted, inside of the width, and no entry over another."""
    words = ("gallbladder", "hatched: a guess, since its motion is not seen well")
    drawn = painted(400, [(text, QColor("red")) for text in words], room)
    needed = QFontMetrics(QApplication.font()).boundingRect(words[1])
    (upper, first), (lower, second) = drawn
    assert (first, second) == words
    assert upper.bottom() <= lower.top()
    assert lower.right() <= room
    assert lower.bottom() <= 400
    assert (lower.height() >= 2 * needed.height() - 4) == (room < needed.width())
