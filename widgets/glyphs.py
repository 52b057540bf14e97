"""Small buttons whose glyphs are drawn in the palette's text colour: right in every theme and at every resolution."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent, QPalette
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QToolButton, QWidget

from degense.widgets.keys import PRESS, keep_keys

_EYE = "M1.5 8Q8 .5 14.5 8 8 15.5 1.5 8M10.2 8A2.2 2.2 0 1 1 5.8 8 2.2 2.2 0 1 1 10.2 8"

#: name → (SVG path in a 16 × 16 box, filled?)
_GLYPHS = {
    "play": ("M4 2 14 8 4 14Z", True),
    "pause": ("M3.5 2.5h3.2v11h-3.2ZM9.3 2.5h3.2v11h-3.2Z", True),
    "next": ("M3 3 10 8 3 13ZM11 3h2v10h-2Z", True),
    "previous": ("M13 3 6 8 13 13ZM3 3h2v10h-2Z", True),
    "first": ("M9.5 3 4.5 8 9.5 13ZM15 3 10 8 15 13ZM1.5 3h2v10h-2Z", True),
    "last": ("M6.5 3 11.5 8 6.5 13ZM1 3 6 8 1 13ZM12.5 3h2v10h-2Z", True),
    "cross": ("M4 4 12 12M12 4 4 12", False),
    "up": ("M3 10 8 5 13 10", False),
    "down": ("M3 6 8 11 13 6", False),
    "plus": ("M8 3V13M3 8H13", False),
    "minus": ("M3 8H13", False),
    "eye": (_EYE, False),
    "brush": ("M13.5 2.5 7.5 8.5M7.5 8.5C5.5 8 4 9.5 4 11 4 12.5 3 13 2 13 4 14.5 8.5 14 8.5 10.5Z", False),
    "eraser": ("M6 13.5 2 9.5 9 2.5 13.5 7 7 13.5ZM5.5 6 10 10.5M4 14H14", False),
    "superpixels": ("M8 1.5 13 4.5V11L8 14 3 11V4.5ZM8 7.5V14M8 7.5 3 4.5M8 7.5 13 4.5", False),
    "polygon": ("M3 12.5 2 5 8 2 13.5 6.5 11 13.5Z", False),
    "fill": ("M3 8 8 3 13 8 8 13ZM3.5 8H12.5M8 3 6 1M14 10.5C15 12 15 13.5 14 13.5S13 12 14 10.5", False),
    "wand": ("M2 14 9.5 6.5M11 1.5V4.5M11 7.5V9.5M7 5H9M12.5 5H15M13.5 2.5 12.5 3.5", False),
    "eye-off": (_EYE + "M2.5 13.5 13.5 2.5", False),
}


class GlyphButton(QToolButton):
    """A tool button with one of the glyphs above; its name, which is its tooltip too, says what it does."""

    def __init__(self, glyph: str, name: str, parent: QWidget | None = None, clicked: Callable[[], object] | None = None) -> None:
        super().__init__(parent)
        self.setAutoRaise(True)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        keep_keys(self, PRESS)
        if clicked is not None:
            self.clicked.connect(lambda checked: clicked())
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
        group = QPalette.ColorGroup.Active if self.isEnabled() else QPalette.ColorGroup.Disabled
        colour = self.palette().color(group, QPalette.ColorRole.ButtonText).name()
        style = f'fill="{colour}"' if self._filled else f'fill="none" stroke="{colour}" stroke-width="1.6" stroke-linecap="round"'
        svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16"><path d="{self._path}" {style}/></svg>'
        side = 0.58 * min(self.width(), self.height())
        with QPainter(self) as painter:  # ended even when painting fails; Qt crashes on a painter left open
            QSvgRenderer(svg.encode()).render(painter, QRectF((self.width() - side) / 2, (self.height() - side) / 2, side, side))
