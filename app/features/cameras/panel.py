"""The list of cameras: stops of a path, to go to, to edit, to fly along."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QTableWidgetItem, QWidget

from degense.widgets import forms
from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import TYPING, keep_keys

_NAME, _FRAME, _SECONDS = range(3)


class CameraList(QWidget):
    """Rows of name, frame and seconds to the next row; name and seconds are edited in place. Signals give the row first."""

    add_requested = Signal()
    remove_requested = Signal(int)
    move_requested = Signal(int, int)
    update_requested = Signal(int)
    chosen = Signal(int)
    renamed = Signal(int, str)
    timed = Signal(int, float)
    flight_requested = Signal()
    movie_requested = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("Cameras")
        self._table = forms.table("Cameras and the path between them", ["Name", "Frame", "Seconds to next"], editable=True)
        self._table.itemChanged.connect(self._edited)
        self._table.itemClicked.connect(lambda item: self.chosen.emit(item.row()))
        keep_keys(self._table, TYPING)
        self._hint = forms.label("Move the camera in the 3D view, then add it. Two or more cameras make a path.", secondary=True)
        add = GlyphButton("plus", "Add the present camera")
        add.clicked.connect(self.add_requested)
        remove, up, down = (GlyphButton(*about) for about in (("cross", "Remove the chosen camera"), ("up", "Earlier"), ("down", "Later")))
        remove.clicked.connect(lambda: self.remove_requested.emit(self.current()))
        up.clicked.connect(lambda: self.move_requested.emit(self.current(), -1))
        down.clicked.connect(lambda: self.move_requested.emit(self.current(), 1))
        tip = "Put the present camera and frame into the chosen row"
        update = forms.button("Update", lambda: self.update_requested.emit(self.current()), tip)
        self._fly = forms.button("Fly along", self.flight_requested.emit, "Move the 3D view along the path; again to stop")
        movie = forms.button("Movie…", self.movie_requested.emit, "Save a movie along the path")
        self._of_row, self._of_path = (remove, up, down, update), (self._fly, movie)
        top = forms.row(add, remove, up, down, 0, update, self._fly, movie, spacing=4)
        forms.column(top, self._hint, (self._table, 1), parent=self)
        self._table.itemSelectionChanged.connect(self._enable)
        self.set_rows(())

    def set_rows(self, rows: Sequence[tuple[str, float, float]], current: int | None = None) -> None:
        """List (name, frame, seconds); the last row has no way to a next one."""
        current = self.current() if current is None else current
        self._table.blockSignals(True)
        self._table.setRowCount(len(rows))
        for i, (name, frame, seconds) in enumerate(rows):
            last = i == len(rows) - 1
            for column, text in enumerate((name, f"{frame:g}", "" if last else f"{seconds:g}")):
                item = QTableWidgetItem(text)
                if column == _FRAME or (column == _SECONDS and last):
                    item.setFlags(item.flags() & ~Qt.ItemFlag.ItemIsEditable)
                self._table.setItem(i, column, item)
        if rows and current >= 0:
            self._table.selectRow(min(current, len(rows) - 1))
        self._table.blockSignals(False)
        self._hint.setVisible(len(rows) < 2)
        self._enable()

    def rows(self) -> list[tuple[str, ...]]:
        """What is written in the list."""
        return forms.texts(self._table)

    def current(self) -> int:
        """The chosen row, −1 for none."""
        rows = self._table.selectionModel().selectedRows()
        return rows[0].row() if rows else -1

    def set_flying(self, flying: bool) -> None:
        self._fly.setText("Stop" if flying else "Fly along")

    def _enable(self) -> None:
        chosen, path = self.current() >= 0, self._table.rowCount() > 1
        for button in self._of_row:
            button.setEnabled(chosen)
        for button in self._of_path:
            button.setEnabled(path)

    def _edited(self, item: QTableWidgetItem) -> None:
        if item.column() == _NAME:
            self.renamed.emit(item.row(), item.text().strip())
        elif item.column() == _SECONDS:
            try:
                seconds = float(item.text().replace(",", "."))
            except ValueError:
                seconds = 0.0  # which the owner refuses, and shows the old one again
            self.timed.emit(item.row(), seconds)
