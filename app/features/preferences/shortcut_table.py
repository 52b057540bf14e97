"""All actions with their keys, which can be changed; keys that two actions want are named."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import (
    QHBoxLayout,
    QHeaderView,
    QKeySequenceEdit,
    QLabel,
    QLineEdit,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from degense.app.shell.actions import ActionRegistry
from degense.widgets.theme import error_colour


class ShortcutTable(QWidget):
    """Choose an action, press the new keys below. A key that another action has is refused until it is taken away there.

    Signals
    -------
    changed()
        The registry has other shortcuts now.
    """

    changed = Signal()

    def __init__(self, registry: ActionRegistry, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Shortcuts")
        self._registry, self._ids = registry, [action.id for action in registry]
        self.search = QLineEdit(placeholderText="Find an action or a key")
        self.search.setAccessibleName("Find an action or a key")
        self.search.setClearButtonEnabled(True)
        self.table = QTableWidget(len(self._ids), 2)
        self.table.setAccessibleName("Actions and their keys")
        self.table.setHorizontalHeaderLabels(["Action", "Keys"])
        self.table.verticalHeader().hide()
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.table.setSelectionBehavior(QTableWidget.SelectionBehavior.SelectRows)
        self.table.setSelectionMode(QTableWidget.SelectionMode.SingleSelection)
        self.table.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.table.setColumnWidth(1, 190)
        self.keys = QKeySequenceEdit()
        self.keys.setAccessibleName("New keys")
        self.keys.setMaximumSequenceLength(1)
        self.set, self.none, self.default = QPushButton("Set"), QPushButton("No keys"), QPushButton("Default")
        self.all_defaults = QPushButton("All defaults")
        self.complaint = QLabel()
        self.complaint.setAccessibleName("What is wrong")
        self.complaint.setWordWrap(True)
        colours = self.complaint.palette()
        colours.setColor(colours.ColorRole.WindowText, error_colour(colours))
        self.complaint.setPalette(colours)
        row = QHBoxLayout()
        row.addWidget(self.keys, 1)
        for button in (self.set, self.none, self.default, self.all_defaults):
            row.addWidget(button)
        column = QVBoxLayout(self)
        column.addWidget(self.search)
        column.addWidget(self.table, 1)
        column.addLayout(row)
        column.addWidget(self.complaint)
        self.search.textChanged.connect(self._filter)
        self.table.itemSelectionChanged.connect(self._chosen)
        self.set.clicked.connect(self._set)
        self.none.clicked.connect(lambda: self._give(()))
        self.default.clicked.connect(lambda: self._give(self._registry[self._id()].shortcuts))
        self.all_defaults.clicked.connect(lambda: self._rebind({}))
        self._fill()
        self.table.selectRow(0)

    def choose(self, action_id: str) -> None:
        """Select an action."""
        self.table.selectRow(self._ids.index(action_id))

    def shown(self, action_id: str) -> str:
        """What the table says about an action's keys."""
        return str(self.table.model().index(self._ids.index(action_id), 1).data())

    def _id(self) -> str:
        return self._ids[max(0, self.table.currentRow())]

    def _fill(self) -> None:
        changed = self._registry.given
        for row, action_id in enumerate(self._ids):
            action = self._registry[action_id]
            place = " ▸ ".join((*action.menu, action.title))
            for column, text in enumerate((place, ", ".join(self._registry.keys(action_id)))):
                item = self.table.item(row, column)
                if item is None:
                    item = QTableWidgetItem()
                    self.table.setItem(row, column, item)
                item.setText(text)
                font = item.font()
                font.setBold(action_id in changed)
                item.setFont(font)

    def _chosen(self) -> None:
        keys = self._registry.keys(self._id())
        self.keys.setKeySequence(QKeySequence(keys[0]) if keys else QKeySequence())
        self.complaint.clear()

    def _set(self) -> None:
        key = self.keys.keySequence().toString(QKeySequence.SequenceFormat.PortableText)
        if not key:
            self.complaint.setText("Press the keys in the field first.")
            return
        action_id = self._id()
        others = self._registry.keys(action_id)[1:]
        self._give((key, *(other for other in others if other != key)))

    def _give(self, keys: tuple[str, ...]) -> None:
        action_id = self._id()
        owners = {key: other.id for other in self._registry for key in self._registry.keys(other.id) if other.id != action_id}
        taken = [
            f"{key} is the shortcut of “{self._registry[owners[key]].title}”. Take it away there first." for key in keys if key in owners
        ]
        if taken:
            self.complaint.setText(" ".join(taken))
            return
        self._rebind(self._registry.given | {action_id: keys})

    def _rebind(self, given: dict[str, tuple[str, ...]]) -> None:
        self.complaint.setText(" ".join(self._registry.rebind(given)))
        self._fill()
        self.changed.emit()

    def _filter(self, text: str) -> None:
        words = text.casefold().split()
        for row in range(len(self._ids)):
            said = " ".join(str(self.table.model().index(row, column).data()) for column in (0, 1)).casefold()
            self.table.setRowHidden(row, not all(word in said for word in words))
