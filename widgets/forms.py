"""Controls and layouts as they look everywhere in the window."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

from PySide6.QtCore import QEvent, QSignalBlocker, Qt, SignalInstance
from PySide6.QtGui import QFontDatabase, QFontMetrics, QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QBoxLayout,
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QDoubleSpinBox,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLayout,
    QLineEdit,
    QPushButton,
    QSpinBox,
    QTableWidget,
    QTableWidgetItem,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from degense.widgets.keys import ARROWS, PRESS, keep_keys
from degense.widgets.theme import error_colour

Layout = TypeVar("Layout", bound=QBoxLayout)
Named = TypeVar("Named", bound=QWidget)
#: What a layout holds: widgets, layouts, either with a stretch factor, or a free space in pixels (0: a stretch).
Item = QWidget | QLayout | tuple[QWidget | QLayout, int] | int


class Painted:
    """For widgets that paint themselves in `_paint`; the first of their bases."""

    def paintEvent(self, event: QPaintEvent) -> None:
        assert isinstance(self, QWidget)
        with QPainter(self) as painter:  # ended even when painting fails; Qt crashes on a painter left open
            self._paint(painter)

    def _paint(self, painter: QPainter) -> None:
        raise NotImplementedError


class PaintedWidget(Painted, QWidget):
    """A plain widget that paints itself."""


def named(widget: Named, name: str, tip: str = "") -> Named:
    """The widget, with its name for those who cannot see it and a tooltip."""
    widget.setAccessibleName(name)
    widget.setToolTip(tip)
    return widget


def row(*items: Item, spacing: int = 6, parent: QWidget | None = None) -> QHBoxLayout:
    """Items beside each other, as the layout of `parent` or without margins in another one."""
    layout = QHBoxLayout(parent) if parent is not None else QHBoxLayout()
    return _fill(layout, items, 0, spacing)


def column(*items: Item, margin: int = 6, spacing: int = 6, parent: QWidget | None = None) -> QVBoxLayout:
    """Items below each other, as the layout of `parent` or in another one."""
    layout = QVBoxLayout(parent) if parent is not None else QVBoxLayout()
    return _fill(layout, items, margin, spacing)


def _fill(layout: Layout, items: Iterable[Item], margin: int, spacing: int) -> Layout:
    layout.setContentsMargins(margin, margin, margin, margin)
    layout.setSpacing(spacing)
    for item in items:
        content, stretch = item if isinstance(item, tuple) else (item, 0)
        if isinstance(content, QLayout):
            layout.addLayout(content, stretch)
        elif isinstance(content, QWidget):
            layout.addWidget(content, stretch)
        elif content:
            layout.addSpacing(content)
        else:
            layout.addStretch(1)
    return layout


def choice(
    name: str, entries: Iterable[tuple[object, str] | tuple[object, str, str]] = (), picked: Callable[[], object] | None = None
) -> QComboBox:
    """A menu of (value, title) or (value, title, tooltip). `picked` is called when the user picks one."""
    box = QComboBox()
    box.setAccessibleName(name)
    for value, title, *tip in entries:
        box.addItem(title, value)
        if tip:
            box.setItemData(box.count() - 1, tip[0], Qt.ItemDataRole.ToolTipRole)
    if picked is not None:
        box.activated.connect(picked)
    keep_keys(box, ARROWS | PRESS)
    return box


def number(name: str, least: int = 0, most: int = 1_000_000, step: int = 1, zero: str = "") -> QSpinBox:
    """A whole number; `zero` is shown in place of the least one."""
    box = named(QSpinBox(minimum=least, maximum=most, singleStep=step), name)
    box.setGroupSeparatorShown(True)
    box.setSpecialValueText(zero)
    return box


def decimal(name: str, least: float, most: float, step: float = 1.0, suffix: str = "", zero: str = "", decimals: int = 1) -> QDoubleSpinBox:
    """A number; `zero` is shown in place of the least one."""
    box = named(QDoubleSpinBox(decimals=decimals, minimum=least, maximum=most, singleStep=step, suffix=suffix), name)
    box.setSpecialValueText(zero)
    return box


def value(control: QWidget) -> Any:
    """What is entered: the value of a menu's row, whether a box is ticked, a number; None for a number that words stand in for."""
    if isinstance(control, QComboBox):
        return control.currentData()
    if isinstance(control, QCheckBox):
        return control.isChecked()
    assert isinstance(control, QSpinBox | QDoubleSpinBox)
    return None if control.specialValueText() and control.value() == control.minimum() else control.value()


def enter(control: QWidget, value: Any) -> None:
    """Show what `value` gives; the first row of a menu for what it does not have."""
    if isinstance(control, QComboBox):
        control.setCurrentIndex(max(0, control.findData(value)))
    elif isinstance(control, QCheckBox):
        control.setChecked(value)
    elif isinstance(control, QSpinBox | QDoubleSpinBox):
        control.setValue(control.minimum() if value is None else value)  # type: ignore[arg-type]


def changed(control: QWidget) -> SignalInstance:
    """The signal that a control's value is another."""
    if isinstance(control, QCheckBox):
        return control.toggled
    assert isinstance(control, QComboBox | QSpinBox | QDoubleSpinBox)
    return control.currentIndexChanged if isinstance(control, QComboBox) else control.valueChanged


def button(title: str, clicked: Callable[[], object], tip: str = "") -> QPushButton:
    """A button that Space and Enter press."""
    made = QPushButton(title)
    made.setToolTip(tip)
    made.setAutoDefault(True)  # Enter presses it outside of dialogs too
    made.clicked.connect(lambda checked: clicked())
    keep_keys(made, PRESS)
    return made


def label(text: str = "", *, name: str = "", secondary: bool = False, wrap: bool = True) -> QLabel:
    """Plain text, never taken for markup; a secondary one is quieter."""
    made = named(QLabel(text, textFormat=Qt.TextFormat.PlainText, wordWrap=wrap), name)
    made.setObjectName("secondary" if secondary else "")
    return made


def complaint() -> QLabel:
    """What is wrong, in the colour of errors."""
    made = label(name="What is wrong")
    colours = made.palette()
    colours.setColor(colours.ColorRole.WindowText, error_colour(colours))
    made.setPalette(colours)
    return made


def tabs(**pages: QWidget) -> QTabWidget:
    """Pages under their titles; an underscore stands for a space."""
    made = named(QTabWidget(documentMode=True), "Pages")
    for title, page in pages.items():
        made.addTab(page, title.replace("_", " "))
    return made


class Dialog(QDialog):
    """A window over another one, `name` is its object name; it is gone when it is closed.

    With larger text it is larger, as far as the screen allows.
    """

    def __init__(self, parent: QWidget, name: str, title: str, width: int, height: int) -> None:
        super().__init__(parent)
        self.setObjectName(name)
        self.setWindowTitle(title)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        usual = QFontMetrics(QFontDatabase.systemFont(QFontDatabase.SystemFont.GeneralFont)).height()
        scale, room = max(1.0, self.fontMetrics().height() / usual), self.screen().availableSize()
        self.resize(min(round(scale * width), room.width()), min(round(scale * height), room.height()))

    def closing(self) -> QDialogButtonBox:
        """A row with the button that closes it. A default button that is added to it is what Enter presses."""
        buttons = QDialogButtonBox(QDialogButtonBox.StandardButton.Close, parent=self)  # without a parent it knows no dialog
        buttons.rejected.connect(self.reject)
        return buttons


class PathLine(QWidget):
    """A path, typed or chosen: `browse` asks for one, beginning at that in `line`; empty when the user cancels."""

    def __init__(self, name: str, browse: Callable[[str], str]) -> None:
        super().__init__()
        self.line = named(QLineEdit(), name)
        choose = named(QPushButton("Choose…"), f"Choose {name[0].lower()}{name[1:]}")
        choose.clicked.connect(lambda: self.line.setText(browse(self.line.text()) or self.line.text()))
        row((self.line, 1), choose, parent=self)


class _Table(QTableWidget):
    """Its rows are as high as its text, also when that becomes larger."""

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange:
            self.verticalHeader().setDefaultSectionSize(self.fontMetrics().height() + 6)


def table(name: str, heads: Sequence[str], *, editable: bool = False) -> QTableWidget:
    """A table of rows of which one can be chosen; its columns share the width."""
    made = _Table(0, len(heads))
    made.setAccessibleName(name)
    made.setHorizontalHeaderLabels(list(heads))
    made.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
    made.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
    trigger = QAbstractItemView.EditTrigger
    made.setEditTriggers(trigger.DoubleClicked | trigger.EditKeyPressed if editable else trigger.NoEditTriggers)
    made.setShowGrid(False)
    made.setTabKeyNavigation(False)
    made.verticalHeader().hide()
    made.changeEvent(QEvent(QEvent.Type.FontChange))
    made.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
    made.horizontalHeader().setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
    return made


def search(of: QTableWidget, columns: Sequence[int], hint: str) -> QLineEdit:
    """A field that hides the rows of a table whose columns do not hold every word that is typed."""
    made = QLineEdit(placeholderText=hint, clearButtonEnabled=True)
    made.setAccessibleName(hint)

    def find(text: str) -> None:
        words = text.casefold().split()
        for index, cells in enumerate(texts(of)):
            inside = " ".join(cells[column] for column in columns).casefold()
            of.setRowHidden(index, not all(word in inside for word in words))

    made.textChanged.connect(find)
    return made


def write(of: QTableWidget, row: int, column: int, text: str, bold: bool = False) -> QTableWidgetItem:
    """Write into a cell, which is made where there is none."""
    item = of.item(row, column)
    if item is None:
        item = QTableWidgetItem()
        of.setItem(row, column, item)
    if item.text() != text:
        item.setText(text)
    if item.font().bold() != bold:
        font = item.font()
        font.setBold(bold)
        item.setFont(font)
    return item


def fill(of: QTableWidget, rows: Sequence[Sequence[str]], right: bool = False) -> None:
    """Show these rows and no others, aligned to the left or the right. Cells are reused; the table tells nobody."""
    side = (Qt.AlignmentFlag.AlignRight if right else Qt.AlignmentFlag.AlignLeft) | Qt.AlignmentFlag.AlignVCenter
    of.horizontalHeader().setDefaultAlignment(side)
    with QSignalBlocker(of):
        of.setRowCount(len(rows))
        for row, cells in enumerate(rows):
            for column, text in enumerate(cells):
                item = write(of, row, column, text)
                item.setTextAlignment(side)
                item.setToolTip(text)


def texts(of: QTableWidget) -> list[tuple[str, ...]]:
    """What is written in the rows of a table."""
    cells = [[of.item(row, column) for column in range(of.columnCount())] for row in range(of.rowCount())]
    return [tuple(item.text() for item in row if item is not None) for row in cells]
