"""A colour bar with its range and colour map."""

from __future__ import annotations

import math

from PySide6.QtCore import QEvent, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QPainter, QPalette
from PySide6.QtWidgets import QComboBox, QLineEdit, QSizePolicy, QWidget

from degense.engine.colour_maps import COLOUR_MAPS, colour_table
from degense.widgets import forms
from degense.widgets.keys import TYPING, keep_keys
from degense.widgets.numbers import short, ticks
from degense.widgets.qt_images import to_qimage

#: Percentages of the values beyond each end that are offered.
CLIPS = (0.0, 0.5, 1.0, 2.0, 5.0)

_MODE_TITLES = {"frame": "This frame", "sequence": "Whole sequence", "fixed": "Fixed"}
RANGE_MODES = tuple(_MODE_TITLES)


class Gradient(forms.PaintedWidget):
    """The bar itself, so many pixels wide, with its ticks."""

    def __init__(self, width: int = 20) -> None:
        super().__init__()
        self._bar = width
        self.low, self.high, self.cmap = 0.0, 1.0, COLOUR_MAPS[0]
        self.beyond = (False, False)  # whether values lie below the first and above the last colour
        self.setAccessibleName("Colours and their numbers")
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Expanding)
        self.setMinimumHeight(120)

    def sizeHint(self) -> QSize:
        return QSize(self._bar + 12 + self.fontMetrics().horizontalAdvance("≥ -0.00000"), 200)

    def _paint(self, painter: QPainter) -> None:
        metrics = painter.fontMetrics()
        edge = metrics.height() / 2 + 1
        bar = QRectF(2, edge, self._bar, max(self.height() - 2 * edge, 1))
        painter.drawImage(bar, to_qimage(colour_table(self.cmap)[::-1, None]))
        painter.setPen(self.palette().color(QPalette.ColorRole.Mid))
        painter.drawRect(bar)
        painter.setPen(self.palette().color(QPalette.ColorRole.WindowText))
        ends = [self.low, self.high]
        count = max(2, int(bar.height() / (3 * metrics.height())))
        inner = ticks(self.low, self.high, count)
        clear = 1.2 * metrics.height() / max(bar.height(), 1) * (self.high - self.low)
        signs = dict(zip(ends, ("≤ " if self.beyond[0] else "", "≥ " if self.beyond[1] else ""), strict=True))
        for value in ends + [v for v in inner if self.low + clear < v < self.high - clear]:
            y = bar.bottom() - (value - self.low) / ((self.high - self.low) or 1.0) * bar.height()
            painter.drawLine(round(bar.right()), round(y), round(bar.right()) + 4, round(y))
            label = QRectF(bar.right() + 7, y - metrics.height() / 2, self.width(), metrics.height())
            painter.drawText(label, Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter, signs.get(value, "") + short(value))


class _Strip(forms.PaintedWidget):
    """The colours from the first to the last, lying."""

    def __init__(self) -> None:
        super().__init__()
        self.cmap = COLOUR_MAPS[0]
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self.setMinimumSize(40, 16)

    def _paint(self, painter: QPainter) -> None:
        edge = max(2, (self.height() - painter.fontMetrics().height()) // 2)
        bar = self.rect().adjusted(0, edge, -1, -edge)
        painter.setOpacity(1.0 if self.isEnabled() else 0.3)
        painter.drawImage(bar, to_qimage(colour_table(self.cmap)[None]))
        painter.setPen(self.palette().color(QPalette.ColorRole.Mid))
        painter.drawRect(bar)


class ColourBar(QWidget):
    """A colour bar with its range: of this frame, of the whole sequence, or fixed by hand."""

    changed = Signal(dict)  # (changes) what the user chose, a dict of some of: mode, low, high, cmap, clip

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Colour bar")
        self._heading = forms.label(wrap=False)
        self._heading.setMinimumWidth(1)
        self._strip, self._range = _Strip(), (0.0, 1.0)
        self._mode_box = forms.choice("Range of the colours", _MODE_TITLES.items(), self._mode_chosen)
        self._map_box = forms.choice("Colour map", [(name, name) for name in COLOUR_MAPS], self._map_chosen)
        shares = [(share, f"clip {share:g} %" if share else "clip none") for share in CLIPS]
        self._clip_box = forms.choice("Share of the values beyond each end", shares, lambda: self.changed.emit({"clip": self.clip()}))
        self._clip_box.setToolTip("Share of the values beyond each end of the range, so that a few strays do not darken the rest")
        for box in (self._mode_box, self._clip_box, self._map_box):
            box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
            box.setMinimumContentsLength(7)
        self._high_field, self._low_field = QLineEdit(self), QLineEdit(self)
        for field, name in ((self._high_field, "Highest value"), (self._low_field, "Lowest value")):
            field.setAccessibleName(name)
            field.setToolTip(name)
            field.editingFinished.connect(self._edited)
            keep_keys(field, TYPING)
        self._set_widths()
        colours = forms.row(self._low_field, (self._strip, 1), self._high_field)
        heading = forms.row((self._heading, 1), self._map_box)
        choices = forms.row((self._mode_box, 5), (self._clip_box, 4), spacing=4)
        forms.column(heading, colours, choices, margin=0, spacing=4, parent=self)
        self.set_range_mode("sequence")
        self.set_clip(1.0)
        self._show_range()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange and hasattr(self, "_low_field"):  # also called from the base class's constructor
            self._set_widths()

    def _set_widths(self) -> None:
        for field in (self._low_field, self._high_field):
            field.setFixedWidth(9 * self.fontMetrics().averageCharWidth() + 12)

    def set_title(self, title: str, unit: str = "") -> None:
        self._heading.setText(f"{title} [{unit}]" if unit else title)
        self._heading.setToolTip(self._heading.text())

    def set_cmap(self, name: str) -> None:
        colour_table(name)
        self._map_box.setCurrentText(name)
        self._strip.cmap = name
        self._strip.update()

    def cmap(self) -> str:
        return self._strip.cmap

    def set_range(self, low: float, high: float) -> None:
        """The numbers of the first and the last colour."""
        if not (math.isfinite(low) and math.isfinite(high)):
            raise ValueError(f"a colour range is finite, not {low} to {high}")
        self._range = float(low), float(high)
        self._show_range()

    def range(self) -> tuple[float, float]:
        return self._range

    def set_range_mode(self, mode: str) -> None:
        if mode not in RANGE_MODES:
            raise ValueError(f"unknown range mode {mode!r}; there are {', '.join(RANGE_MODES)}")
        self._mode_box.setCurrentIndex(RANGE_MODES.index(mode))
        self._clip_box.setEnabled(mode != "fixed")

    def set_clip(self, share: float) -> None:
        """Percentage of the values beyond each end; one that is not offered is added."""
        if self._clip_box.findData(share) < 0:
            self._clip_box.addItem(f"clip {share:g} %", share)
        self._clip_box.setCurrentIndex(self._clip_box.findData(share))

    def clip(self) -> float:
        return self._clip_box.currentData()

    def range_mode(self) -> str:
        return self._mode_box.currentData()

    def _show_range(self) -> None:
        for field, value in zip((self._low_field, self._high_field), self._range, strict=True):
            field.setText(short(value, 5))
            field.setModified(False)
            field.setCursorPosition(0)

    def _edited(self) -> None:
        """A number was typed: take it when it is one and the range stays a range, else show the old one again."""
        if not (self._low_field.isModified() or self._high_field.isModified()):
            return
        typed = []
        for field, old in zip((self._low_field, self._high_field), self._range, strict=True):
            try:
                typed.append(float(field.text().replace(",", ".")) if field.isModified() else old)
            except ValueError:
                self._show_range()
                return
        low, high = typed
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            self._show_range()
            return
        self.set_range(low, high)
        self.set_range_mode("fixed")
        self._mode_chosen()

    def _mode_chosen(self) -> None:
        """A fixed range begins as the one that is shown."""
        low, high = self.range()
        self.changed.emit({"mode": self.range_mode(), "low": low, "high": high})

    def _map_chosen(self) -> None:
        self.set_cmap(self._map_box.currentText())
        self.changed.emit({"cmap": self.cmap()})
