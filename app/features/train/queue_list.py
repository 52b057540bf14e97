"""The trainings that wait for their turn."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QListWidget, QWidget

from degense.widgets import forms
from degense.widgets.keys import ARROWS, keep_keys


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
        self.list = QListWidget()
        self.list.setAccessibleName("Waiting trainings, the next one first")
        self.list.currentRowChanged.connect(lambda row: self._enable())
        keep_keys(self.list, ARROWS)
        self.earlier = forms.button("Earlier", lambda: self.raised.emit(self.list.currentRow()), "Start it before the one above")
        self.remove = forms.button("Remove", lambda: self.removed.emit(self.list.currentRow()), "Take it out of the queue")
        buttons = forms.row(self.earlier, self.remove)
        forms.column(forms.label("Waiting", secondary=True), (self.list, 1), buttons, margin=0, spacing=4, parent=self)
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
