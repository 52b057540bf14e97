"""All actions with their keys, which can be changed; keys that two actions want are named."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtGui import QKeySequence
from PySide6.QtWidgets import QHeaderView, QKeySequenceEdit, QPushButton, QWidget

from degense.app.shell.actions import ActionRegistry
from degense.widgets import forms


class ShortcutTable(QWidget):
    """Choose an action, press the new keys below. A key that another action has is refused until it is taken away there."""

    changed = Signal()  # the registry has other shortcuts now

    def __init__(self, registry: ActionRegistry, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Shortcuts")
        self._registry, self.ids = registry, [action.id for action in registry]
        self.table = forms.table("Actions and their keys", ("Action", "Keys"))
        self.table.setRowCount(len(self.ids))
        self.table.setShowGrid(True)
        self.table.horizontalHeader().setSectionResizeMode(1, QHeaderView.ResizeMode.Interactive)
        self.table.setColumnWidth(1, 190)
        self.search = forms.search(self.table, (0, 1), "Find an action or a key")
        self.keys = QKeySequenceEdit()
        self.keys.setAccessibleName("New keys")
        self.keys.setMaximumSequenceLength(1)
        self.set, self.none, self.default = QPushButton("Set"), QPushButton("No keys"), QPushButton("Default")
        self.all_defaults = QPushButton("All defaults")
        self.complaint = forms.complaint()
        row = forms.row((self.keys, 1), self.set, self.none, self.default, self.all_defaults)
        forms.column(self.search, (self.table, 1), row, self.complaint, margin=9, parent=self)
        self.table.itemSelectionChanged.connect(self._chosen)
        self.set.clicked.connect(self._set)
        self.none.clicked.connect(lambda: self._give(()))
        self.default.clicked.connect(lambda: self._give(self._registry[self._id()].shortcuts))
        self.all_defaults.clicked.connect(lambda: self._rebind({}))
        self._fill()
        self.table.selectRow(0)

    def _id(self) -> str:
        return self.ids[max(0, self.table.currentRow())]

    def _fill(self) -> None:
        changed = self._registry.given
        for row, action_id in enumerate(self.ids):
            action = self._registry[action_id]
            place = " ▸ ".join((*action.menu, action.title))
            for column, text in enumerate((place, ", ".join(self._registry.keys(action_id)))):
                forms.write(self.table, row, column, text, action_id in changed)

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
