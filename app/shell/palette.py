"""The command palette: type a few letters of what you want to do."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QModelIndex, QObject, QPersistentModelIndex, Qt
from PySide6.QtGui import QKeyEvent, QPainter, QPalette
from PySide6.QtWidgets import (
    QDialog,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from degense.app.shell.actions import ActionRegistry
from degense.widgets import forms

KEYS = Qt.ItemDataRole.UserRole + 1
#: Size in characters and lines, and how far below the window's top it is, pixels.
WIDTH, HEIGHT, DOWN = 72, 26, 60


class _Keys(QStyledItemDelegate):
    """Writes the keys of an action at the right of its row."""

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> None:
        super().paint(painter, option, index)
        chosen = bool(option.state & QStyle.StateFlag.State_Selected)
        role = QPalette.ColorRole.HighlightedText if chosen else QPalette.ColorRole.PlaceholderText
        painter.setPen(option.palette.color(role))
        aligned = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        painter.drawText(option.rect.adjusted(0, 0, -6, 0), aligned, index.data(KEYS) or "")


class Palette(QDialog):
    """Finds an action by its words and runs it. Arrows choose, Enter runs, Escape leaves."""

    def __init__(self, registry: ActionRegistry, run: Callable[[str], None], parent: QWidget) -> None:
        super().__init__(parent, Qt.WindowType.Popup)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._registry, self._run_action = registry, run
        self.input = forms.named(QLineEdit(placeholderText="What do you want to do?"), "What do you want to do?")
        self.list = forms.named(QListWidget(), "Actions that fit")
        self.list.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.list.setItemDelegate(_Keys(self.list))
        forms.column(self.input, self.list, parent=self)
        self.input.textChanged.connect(self._fill)
        self.input.returnPressed.connect(self._run)
        self.input.installEventFilter(self)
        self.list.itemClicked.connect(lambda item: self._run())
        self._fill("")
        metrics = self.fontMetrics()
        self.resize(min(WIDTH * metrics.averageCharWidth(), parent.width()), min(HEIGHT * metrics.height(), parent.height() - DOWN))
        self.move(
            parent.mapToGlobal(parent.rect().center()).x() - self.width() // 2, parent.mapToGlobal(parent.rect().topLeft()).y() + DOWN
        )

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.KeyPress and isinstance(event, QKeyEvent):
            step = {Qt.Key.Key_Down: 1, Qt.Key.Key_Up: -1}.get(Qt.Key(event.key()))
            if step:
                self.list.setCurrentRow((self.list.currentRow() + step) % max(1, self.list.count()))
                return True
        return False

    def _fill(self, text: str) -> None:
        self.list.clear()
        for action in self._registry.search(text):
            if action.id != "help.palette":
                place = " ▸ ".join((*action.menu, action.title))
                keys = self._registry.keys(action.id)
                item = QListWidgetItem(place)
                item.setData(Qt.ItemDataRole.UserRole, action.id)
                item.setData(KEYS, keys[0] if keys else "")
                item.setData(Qt.ItemDataRole.AccessibleTextRole, f"{place}, {keys[0]}" if keys else place)
                self.list.addItem(item)
        self.list.setCurrentRow(0)

    def _run(self) -> None:
        item = self.list.currentItem()
        if item is not None:
            self.close()
            self._run_action(item.data(Qt.ItemDataRole.UserRole))
