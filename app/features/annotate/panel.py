"""The annotation panel: tools, classes, and the review of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from math import log2

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import (
    QButtonGroup,
    QComboBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QSlider,
    QToolButton,
    QWidget,
)

from degense.app.features.annotate.class_list import ClassList
from degense.widgets import forms
from degense.widgets.keys import ARROWS, PRESS, TYPING, keep_keys

#: Steps of the size slider an octave of the radius.
OCTAVE = 12
SMALLEST = 0.5


class AnnotationPanel(QWidget):
    """Shows the state it is given, and emits what the user wants.

    Signals
    -------
    tool_chosen(name), radius_chosen(pixels), lock_chosen(value or −1), status_chosen(status), class_added(name)
    asked(action)
        A button: the id of the action it stands for.
    """

    tool_chosen = Signal(str)
    radius_chosen = Signal(float)
    lock_chosen = Signal(int)
    status_chosen = Signal(str)
    class_added = Signal(str)
    asked = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Annotation")
        self.classes = ClassList(self)
        self._tools = QButtonGroup(self)
        self._buttons: dict[str, QPushButton] = {}
        self._tool_row = QGridLayout()
        self._tool_row.setSpacing(4)
        self._slider = QSlider(Qt.Orientation.Horizontal)
        self._slider.setAccessibleName("Size of the brush")
        self._slider.setToolTip("Size of the brush; keys [ and ]")
        self._slider.setRange(0, 8 * OCTAVE - 8)
        self._slider.valueChanged.connect(lambda step: self.radius_chosen.emit(SMALLEST * 2 ** (step / OCTAVE)))
        keep_keys(self._slider, ARROWS)
        self._size = QLabel()
        self._size.setMinimumWidth(self.fontMetrics().horizontalAdvance("200 px "))
        self._new = QLineEdit(placeholderText="Another class…")
        self._new.setAccessibleName("Name of another class")
        self._new.returnPressed.connect(self._add_class)
        keep_keys(self._new, TYPING)
        self._lock = self._combo("Paint only inside a class, whatever the tool covers")
        self._lock.activated.connect(lambda row: self.lock_chosen.emit(self._lock.itemData(row)))
        self._status = self._combo("How far the review of this frame is")
        self._status.activated.connect(lambda row: self.status_chosen.emit(self._status.itemText(row)))
        self.frame, self.summary = forms.label(), forms.label(secondary=True)
        self._progress = QProgressBar(textVisible=False)
        self._progress.setMaximumHeight(8)
        self._progress.setAccessibleName("Progress")
        self._progress.hide()
        forms.column(
            self._tool_row,
            forms.row(QLabel("Size"), (self._slider, 1), self._size),
            (self.classes, 1),
            self._new,
            forms.row(QLabel("Only inside"), (self._lock, 1)),
            self._button_row(holes="Fill holes", largest="Largest", prompt="From prompt"),
            forms.row((self.frame, 1), self._status),
            self._button_row(accept="Accept", reject="Reject", next="Next flagged"),
            self.summary,
            self._button_row(propagate="Propagate to all frames", stop="Stop"),
            self._progress,
            self._button_row(accept_all="Accept all", reject_all="Reject all", teach="Train…"),
            parent=self,
        ).setContentsMargins(8, 6, 8, 6)

    def _button_row(self, **buttons: str) -> QHBoxLayout:
        """Buttons for actions of this feature: their names and what stands on them."""
        made = {f"annotate.{name.replace('_', '-')}": text for name, text in buttons.items()}
        self._buttons |= {action: forms.button(text, partial(self.asked.emit, action)) for action, text in made.items()}
        return forms.row(*(self._buttons[action] for action in made), spacing=4)

    def _combo(self, tip: str) -> QComboBox:
        box = QComboBox()
        box.setToolTip(tip)
        box.setAccessibleName(tip)
        box.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        box.setMinimumContentsLength(9)
        return box

    # Choices

    def set_tools(self, tools: Sequence[tuple[str, str, str]]) -> None:
        """Offer tools: (name, title, description)."""
        for index, (name, title, description) in enumerate(tools):
            button = QToolButton()
            button.setText(title)
            button.setToolTip(description)
            button.setAccessibleName(title)
            button.setObjectName(name)
            button.setCheckable(True)
            button.setSizePolicy(self.sizePolicy().Policy.Expanding, self.sizePolicy().Policy.Fixed)
            button.clicked.connect(lambda _checked=False, name=name: self.tool_chosen.emit(name))
            keep_keys(button, PRESS)
            self._tools.addButton(button)
            self._tool_row.addWidget(button, index // 3, index % 3)

    def set_statuses(self, statuses: Sequence[str]) -> None:
        self._status.clear()
        self._status.addItems(list(statuses))

    def set_locks(self, locks: Sequence[tuple[str, int]]) -> None:
        """Offer what may be painted over: (text, label); −1 is everything."""
        current = self._lock.currentData()
        self._lock.clear()
        for text, value in locks:
            self._lock.addItem(text, value)
        self._lock.setCurrentIndex(max(0, self._lock.findData(current)))

    # State

    def set_tool(self, name: str, radius: float, lock: int) -> None:
        for button in self._tools.buttons():
            button.setChecked(button.objectName() == name)
        with QSignalBlocker(self._slider):
            self._slider.setValue(round(OCTAVE * log2(max(1.0, radius / SMALLEST))))
        self._size.setText(f"{2 * radius:.0f} px" if radius >= 1 else "1 px")
        self._lock.setCurrentIndex(max(0, self._lock.findData(lock)))

    def set_frame(self, text: str, status: str) -> None:
        """Describe the frame that is shown."""
        self.frame.setText(text)
        self._status.setCurrentText(status)

    def follow(self, actions: Mapping[str, QAction]) -> None:
        """Let each button be pressed when the action that it stands for can be done, and show its keys."""
        for name, button in self._buttons.items():
            action = actions[name]
            keys = action.shortcut().toString()
            button.setToolTip(f"{action.text()} ({keys})" if keys else action.text())
            button.setEnabled(action.isEnabled())
            action.enabledChanged.connect(button.setEnabled)

    def button(self, action: str) -> QPushButton:
        return self._buttons[action]

    def set_progress(self, fraction: float | None) -> None:
        """How far the propagation is, in [0, 1]; None while nothing is propagated."""
        self._progress.setVisible(fraction is not None)
        if fraction is not None:
            self._progress.setRange(0, 1000)
            self._progress.setValue(round(1000 * fraction))

    def _add_class(self) -> None:
        name = self._new.text().strip()
        if name:
            self._new.clear()
            self.class_added.emit(name)
