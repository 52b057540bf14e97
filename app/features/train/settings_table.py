"""Every setting of a training with its value and what it does; values may be changed."""

from __future__ import annotations

import json
from typing import Any

from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import QHeaderView, QTableWidget, QTableWidgetItem, QWidget

from degense.app.features.train.job import NAMED
from degense.app.features.train.settings_help import settings_of
from degense.engine.training import TrainConfig
from degense.widgets import forms


class SettingsTable(QWidget):
    """The values that a preset leads to, and those the user has typed over them (bold)."""

    changed = Signal()  # the user has typed a value, or emptied a cell to have the preset's again

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("All settings")
        self.table = QTableWidget(0, 3)
        self.table.setAccessibleName("Settings, their values and what they do")
        self.table.setHorizontalHeaderLabels(["Setting", "Value", "What it does"])
        self.table.verticalHeader().hide()
        self.table.setWordWrap(True)
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(1, QHeaderView.ResizeMode.Interactive)
        header.setSectionResizeMode(2, QHeaderView.ResizeMode.Stretch)
        header.resizeSection(1, 110)
        self.table.itemChanged.connect(self._edited)
        self.search = forms.search(self.table, (0, 2), "Find a setting by its name or its words")
        forms.column(self.search, (self.table, 1), margin=0, parent=self)
        self.typed: dict[str, str] = {}  # the text of each setting that the user has typed over; `show_config` shows them

    def show_config(self, config: TrainConfig) -> None:
        blocker = QSignalBlocker(self.table)
        settings = settings_of(config)
        first = self.table.rowCount() == 0
        self.table.setRowCount(len(settings))
        for row, setting in enumerate(settings):
            fixed = setting.name in NAMED
            text = _text(setting.value)
            for column, words in enumerate((setting.name, text, setting.words.replace("`", ""))):
                item = forms.write(self.table, row, column, words, setting.changed and column < 2)
                flags = Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable
                item.setFlags(flags | Qt.ItemFlag.ItemIsEditable if column == 1 and not fixed else flags)
                if column == 1:
                    item.setToolTip("Set on the first page" if fixed else "Double-click to change; empty it for the preset's value")
        blocker.unblock()
        if first:
            self.table.resizeRowsToContents()

    def _edited(self, item: QTableWidgetItem) -> None:
        if item.column() == 1:
            name, text = str(self.table.model().index(item.row(), 0).data()), item.text().strip()
            if text:
                self.typed[name] = text
            else:
                self.typed.pop(name, None)
            self.changed.emit()

    def resizeEvent(self, event: Any) -> None:
        super().resizeEvent(event)
        self.table.resizeRowsToContents()


def _text(value: Any) -> str:
    return json.dumps(list(value) if isinstance(value, tuple) else value).strip('"')
