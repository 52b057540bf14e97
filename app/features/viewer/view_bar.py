"""A small colour bar that lies over a view, so that values can be read beside the frame."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QWidget

from degense.engine.colour_maps import colour_table
from degense.widgets.forms import PaintedWidget
from degense.widgets.qt_images import to_qimage
from degense.widgets.ticks import short

_EDGE, _BAR, _GAP, _HEIGHT = 8, 12, 5, 110


class ViewBar(PaintedWidget):
    """Lies in the upper right corner of the widget that it is given, and lets the mouse through."""

    def __init__(self, host: QWidget) -> None:
        super().__init__(host)
        self._host = host
        self.setAccessibleName("Colour bar in the view")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._low, self._high, self._cmap, self._title = 0.0, 1.0, "viridis", ""
        host.installEventFilter(self)
        self.hide()

    def show_range(self, title: str, low: float, high: float, cmap: str) -> None:
        """Show the numbers of the first and the last colour, under a title with the unit."""
        if (title, low, high, cmap) != (self._title, self._low, self._high, self._cmap) or self.isHidden():
            self._title, self._low, self._high, self._cmap = title, low, high, cmap
            self.resize(self.sizeHint())
            self._stay()
            self.update()
        self.show()
        self.raise_()

    def texts(self) -> tuple[str, str, str]:
        """Title, largest and smallest number, as written."""
        return self._title, short(self._high, 3), short(self._low, 3)

    def sizeHint(self) -> QSize:
        metrics = self.fontMetrics()
        numbers = max(metrics.horizontalAdvance(text) for text in self.texts()[1:])
        width = max(metrics.horizontalAdvance(self._title), _BAR + _GAP + numbers)
        return QSize(width + 2 * _EDGE, _HEIGHT + metrics.height() + 2 * _EDGE)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.Resize, QEvent.Type.Show):
            self._stay()
        return False

    def _stay(self) -> None:
        self.move(self._host.width() - self.width() - _EDGE, _EDGE)

    def _paint(self, painter: QPainter) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(0, 0, 0, 150))
        painter.drawRoundedRect(self.rect(), 4, 4)
        title, high, low = self.texts()
        line = painter.fontMetrics().height()
        painter.setPen(QColor(255, 255, 255))
        painter.drawText(QRectF(_EDGE, _EDGE - 2, self.width(), line), Qt.AlignmentFlag.AlignLeft, title)
        bar = QRectF(_EDGE, _EDGE + line + 2, _BAR, _HEIGHT - 2)
        painter.drawImage(bar, to_qimage(colour_table(self._cmap)[::-1, None]))
        right = bar.right() + _GAP
        painter.drawText(QRectF(right, bar.top() - 2, self.width(), line), Qt.AlignmentFlag.AlignLeft, high)
        painter.drawText(QRectF(right, bar.bottom() - line + 2, self.width(), line), Qt.AlignmentFlag.AlignLeft, low)
        if self._low < 0 < self._high:
            zero = bar.bottom() + self._low / (self._high - self._low) * bar.height()
            painter.drawText(QRectF(right, zero - line / 2, self.width(), line), Qt.AlignmentFlag.AlignLeft, "0")
