"""A colour bar with its range and colour map."""

from __future__ import annotations

import math

from PySide6.QtCore import QEvent, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QPainter, QPalette
from PySide6.QtWidgets import QComboBox, QLineEdit, QSizePolicy, QStyle, QStyleOptionComboBox, QWidget

from degense.engine.colour_maps import COLOUR_MAPS, colour_table
from degense.widgets import forms
from degense.widgets.elided import ElidedLabel
from degense.widgets.keys import ARROWS, PRESS, TYPING, keep_keys
from degense.widgets.numbers import short, ticks
from degense.widgets.qt_images import to_qimage

#: Percentages of the values beyond each end that are offered.
CLIPS = (0.0, 0.5, 1.0, 2.0, 5.0)
#: Length of a tick, and the least free space between two numbers, pixels.
TICK, GAP = 3, 8

_MODE_TITLES = {"frame": "This frame", "sequence": "All frames", "fixed": "Fixed"}
RANGE_MODES = tuple(_MODE_TITLES)


class Gradient(forms.PaintedWidget):
    """The colours from the first to the last, lying, with numbers below."""

    def __init__(self) -> None:
        super().__init__()
        self.low, self.high, self.cmap = 0.0, 1.0, COLOUR_MAPS[0]
        self.beyond = (False, False)  # whether values lie below the first and above the last colour
        self.setAccessibleName("Colours and their numbers")
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def sizeHint(self) -> QSize:
        metrics = self.fontMetrics()
        return QSize(metrics.horizontalAdvance("≤ -0.00000  ≥ -0.00000"), metrics.height() + metrics.ascent() + TICK)

    def minimumSizeHint(self) -> QSize:
        return self.sizeHint()

    def _paint(self, painter: QPainter) -> None:
        metrics, palette = painter.fontMetrics(), self.palette()
        bar = QRectF(0, 0, self.width() - 1, self.height() - metrics.height() - TICK)
        painter.drawImage(bar, to_qimage(colour_table(self.cmap)[None]))
        painter.setPen(palette.color(QPalette.ColorRole.Mid))
        painter.drawRect(bar)
        painter.setPen(palette.color(QPalette.ColorRole.WindowText))
        signs = "≤ " * self.beyond[0], "≥ " * self.beyond[1]
        words = [(value, sign + short(value)) for value, sign in zip((self.low, self.high), signs, strict=True)]
        words += [(value, short(value)) for value in ticks(self.low, self.high, 3) if self.low < value < self.high]
        taken: list[tuple[float, float]] = []  # where numbers stand already; those of the ends come first
        for value, text in words:
            x, width = (value - self.low) / ((self.high - self.low) or 1.0) * bar.width(), metrics.horizontalAdvance(text)
            left = min(max(x - width / 2, 0.0), self.width() - width)
            if all(left > end + GAP or left + width < start - GAP for start, end in taken):
                taken.append((left, left + width))
                painter.drawLine(round(x), round(bar.bottom()), round(x), round(bar.bottom()) + TICK)
                place = QRectF(left, bar.bottom() + TICK, width + 1, metrics.height())
                painter.drawText(place, Qt.AlignmentFlag.AlignCenter, text)


class _MapBox(forms.Painted, QComboBox):
    """The choice of a colour map, which shows its colours in place of its name."""

    def __init__(self) -> None:
        super().__init__()
        forms.named(self, "Colour map", "Colour map").addItems(COLOUR_MAPS)
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(7)
        keep_keys(self, ARROWS | PRESS)

    def _paint(self, painter: QPainter) -> None:
        option, box, part = QStyleOptionComboBox(), QStyle.ComplexControl.CC_ComboBox, QStyle.SubControl.SC_ComboBoxEditField
        self.initStyleOption(option)
        self.style().drawComplexControl(box, option, painter, self)
        field = self.style().subControlRect(box, option, part, self)
        painter.setOpacity(1.0 if self.isEnabled() else 0.3)
        painter.drawImage(field.adjusted(2, 2, -2, -2), to_qimage(colour_table(self.currentText())[None]))


class ColourBar(QWidget):
    """A colour bar with its range: of this frame, of the whole sequence, or fixed by hand."""

    changed = Signal(dict)  # (changes) what the user chose, a dict of some of: mode, low, high, cmap, clip

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Colour bar")
        self._heading, self._range = ElidedLabel("Layer of the colours"), (0.0, 1.0)
        self._mode_box = forms.choice("Range of the colours", _MODE_TITLES.items(), self._mode_chosen)
        self._map_box = _MapBox()
        self._map_box.activated.connect(self._map_chosen)
        shares = [(share, f"clip {share:g} %" if share else "clip none") for share in CLIPS]
        self._clip_box = forms.choice("Share of the values beyond each end", shares, lambda: self.changed.emit({"clip": self.clip()}))
        self._clip_box.setToolTip("Share of the values beyond each end of the range, so that a few strays do not darken the rest")
        for box in (self._mode_box, self._clip_box):
            box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
            box.setMinimumContentsLength(7)
        self._high_field, self._low_field = QLineEdit(self), QLineEdit(self)
        for field, name in ((self._high_field, "Highest value"), (self._low_field, "Lowest value")):
            field.setAccessibleName(name)
            field.setToolTip(name)
            field.editingFinished.connect(self._edited)
            keep_keys(field, TYPING)
        self._set_widths()
        colours = forms.row(self._low_field, (self._map_box, 1), self._high_field)
        choices = forms.row((self._mode_box, 5), (self._clip_box, 4), spacing=4)
        forms.column(self._heading, colours, choices, margin=0, spacing=4, parent=self)
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

    def set_title(self, title: str) -> None:
        self._heading.setText(title)

    def set_cmap(self, name: str) -> None:
        colour_table(name)  # refuses others
        self._map_box.setCurrentText(name)

    def cmap(self) -> str:
        return self._map_box.currentText()

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
        self.changed.emit({"cmap": self.cmap()})
