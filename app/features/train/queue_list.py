"""The trainings that wait for their turn."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QHBoxLayout, QLabel, QListWidget, QPushButton, QVBoxLayout, QWidget

from degense.widgets.keys import ARROWS, PRESS, keep_keys


class RunQueue(QWidget):
    """A list with the next one first. It asks for changes and shows what it is given.

    Signals
    -------
    removed(row), raised(row)
        Take a training out of the queue; let it come earlier.
    """

    removed = Signal(int)
    raised = Signal(int)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Waiting trainings")
        title = QLabel("Waiting")
        title.setObjectName("secondary")
        self.list = QListWidget()
        self.list.setAccessibleName("Waiting trainings, the next one first")
        self.earlier, self.remove = QPushButton("Earlier"), QPushButton("Remove")
        for button, words in ((self.earlier, "Let it come before the one above"), (self.remove, "Take it out of the queue")):
            button.setToolTip(words)
            keep_keys(button, PRESS)
        keep_keys(self.list, ARROWS)
        self.earlier.clicked.connect(lambda: self.raised.emit(self.list.currentRow()))
        self.remove.clicked.connect(lambda: self.removed.emit(self.list.currentRow()))
        self.list.currentRowChanged.connect(lambda row: self._enable())
        buttons = QHBoxLayout()
        buttons.addWidget(self.earlier)
        buttons.addWidget(self.remove)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(4)
        column.addWidget(title)
        column.addWidget(self.list, 1)
        column.addLayout(buttons)
        self.set_runs(())

    def set_runs(self, names: Sequence[str]) -> None:
        """Show these, and nothing at all when there are none."""
        row = self.list.currentRow()
        self.list.clear()
        self.list.addItems(list(names))
        self.list.setCurrentRow(min(max(0, row), len(names) - 1))
        self.setVisible(bool(names))
        self._enable()

    def names(self) -> list[str]:
        return [self.list.item(row).text() for row in range(self.list.count())]

    def _enable(self) -> None:
        row = self.list.currentRow()
        self.remove.setEnabled(row >= 0)
        self.earlier.setEnabled(row > 0)
