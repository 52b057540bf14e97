"""Which layer the views show, and how strongly masks lie over it."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import QButtonGroup, QCheckBox, QGridLayout, QLabel, QRadioButton, QSlider, QWidget

from degense.widgets import forms
from degense.widgets.keys import ARROWS, PRESS, keep_keys

#: So many layers stand in two columns, one below the other in each.
TWO_COLUMNS_FROM = 7


class LayerList(QWidget):
    """One radio button a layer, with unit and formula in its tooltip."""

    layer_changed = Signal(str)
    opacity_changed = Signal(float)
    masks_toggled = Signal(bool)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Layers")
        self._group = QButtonGroup(self)
        self._buttons: dict[str, QRadioButton] = {}
        self._tips: dict[str, str] = {}
        self._list = QGridLayout()
        self._list.setVerticalSpacing(2)
        self._list.setHorizontalSpacing(10)
        self._masks = QCheckBox("Masks", self)
        self._masks.setToolTip("Lay the masks of the prompts over the layer")
        self._masks.setChecked(True)
        self._masks.clicked.connect(self.masks_toggled)
        keep_keys(self._masks, PRESS)
        self._slider = QSlider(Qt.Orientation.Horizontal, self)
        self._slider.setAccessibleName("Opacity of the masks")
        self._slider.setToolTip("Opacity of the masks")
        self._slider.setRange(0, 100)
        self._slider.setPageStep(10)
        self._slider.setMinimumWidth(60)
        self._slider.valueChanged.connect(self._opacity_moved)
        keep_keys(self._slider, ARROWS)
        self._percent = QLabel(self)
        self._percent.setMinimumWidth(self.fontMetrics().horizontalAdvance("100 %"))
        self._percent.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        row = forms.row(self._masks, (self._slider, 1), self._percent)
        forms.column(self._list, row, 0, parent=self)
        self.set_opacity(1.0)

    def set_layers(self, layers: Sequence[tuple[str, str, str, str]]) -> None:
        """Offer other layers: (name, title, unit, description). The first becomes current unless the current one is among them."""
        current = self.current()
        for button in self._buttons.values():
            button.setParent(None)
        self._buttons.clear()
        rows = len(layers) if len(layers) < TWO_COLUMNS_FROM else (len(layers) + 1) // 2
        for place, (name, title, unit, description) in enumerate(layers):
            button = QRadioButton(f"{title}  [{unit}]" if unit else title, self)
            button.clicked.connect(lambda _checked=False, name=name: self.layer_changed.emit(name))
            keep_keys(button, ARROWS | PRESS)
            self._tips[name] = description
            button.setToolTip(description)
            self._group.addButton(button)
            self._list.addWidget(button, place % rows, place // rows)
            self._buttons[name] = button
        if self._buttons:
            self.set_current(current if current in self._buttons else next(iter(self._buttons)))

    def set_current(self, name: str) -> None:
        if name not in self._buttons:
            raise ValueError(f"unknown layer {name!r}; there are {', '.join(self._buttons)}")
        self._buttons[name].setChecked(True)

    def current(self) -> str:
        return next((name for name, button in self._buttons.items() if button.isChecked()), "")

    def set_available(self, name: str, on: bool, reason: str = "") -> None:
        """Grey a layer out, with the reason in its tooltip, or offer it again."""
        self._buttons[name].setEnabled(on)
        self._buttons[name].setToolTip(self._tips[name] if on or not reason else f"{self._tips[name]}\n\nNot available: {reason}")

    def set_opacity(self, opacity: float) -> None:
        with QSignalBlocker(self._slider):
            self._slider.setValue(round(100 * opacity))
        self._percent.setText(f"{self._slider.value()} %")

    def set_masks_shown(self, on: bool) -> None:
        self._masks.setChecked(on)

    def _opacity_moved(self) -> None:
        self._percent.setText(f"{self._slider.value()} %")
        self.opacity_changed.emit(self._slider.value() / 100)
