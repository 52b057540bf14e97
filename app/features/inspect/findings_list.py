"""A list of findings, the worst first, to jump to."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QTableWidgetItem, QWidget

from degense.widgets import forms
from degense.widgets.keys import ARROWS, keep_keys

KINDS = (("frames", "Worst frames"), ("places", "Worst places"))


class RankingList(QWidget):
    """Rows of frame, place and value; `chosen` gives the row to see, `kind_changed` one of `KINDS`."""

    search_requested = Signal()
    kind_changed = Signal(str)
    chosen = Signal(int)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Worst frames and places")
        self._kinds = forms.choice("What is listed", KINDS, lambda: self.kind_changed.emit(self.kind()))
        find = forms.button("Find", self.search_requested.emit, "Search all frames of the layer that is shown")
        self._note = forms.label(secondary=True)
        self._table = forms.table("Findings", ["", "", ""])
        self._table.currentCellChanged.connect(lambda row, *_: self.chosen.emit(row) if row >= 0 else None)
        keep_keys(self._table, ARROWS)
        forms.column(forms.row((self._kinds, 1), find), self._note, (self._table, 1), parent=self)
        self.set_note("")

    def kind(self) -> str:
        return self._kinds.currentData()

    def set_note(self, text: str) -> None:
        """What is listed, or why nothing is."""
        self._note.setText(text)
        self._note.setVisible(bool(text))

    def set_findings(self, unit: str, rows: Sequence[tuple[int, float, float, float]]) -> None:
        """List (frame, x, y, value) rows. Nothing is chosen."""
        self._table.blockSignals(True)
        self._table.setHorizontalHeaderLabels(["Frame", "Place [px]", f"Value [{unit}]" if unit else "Value"])
        self._table.clearSelection()
        self._table.setCurrentCell(-1, -1)
        self._table.setRowCount(len(rows))
        for i, (frame, x, y, value) in enumerate(rows):
            for column, text in enumerate((str(frame), f"{x:.0f}, {y:.0f}", f"{value:.3g}")):
                item = QTableWidgetItem(text)
                item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                self._table.setItem(i, column, item)
        self._table.blockSignals(False)

    def rows(self) -> list[tuple[str, ...]]:
        """What is written in the list."""
        return forms.texts(self._table)

    def choose(self, step: int) -> None:
        """Go to the next finding (or back), round and round."""
        count = self._table.rowCount()
        if count:
            row = self._table.currentRow()
            self._table.setCurrentCell((row + step) % count if row >= 0 else 0, 0)

    def current(self) -> int:
        return self._table.currentRow()
