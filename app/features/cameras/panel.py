"""The list of cameras: stops of a path, to go to, to edit, to fly along."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QTableWidgetItem, QWidget

from degense.app.features.cameras.state import LONGEST_SECONDS, CameraBook
from degense.widgets import forms
from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import TYPING, keep_keys

_NAME, _FRAME, _SECONDS = range(3)


class CameraList(QWidget):
    """Rows of name, frame and seconds to the next row; name and seconds are edited in place. `say` tells when an edit is refused."""

    add_requested = Signal()
    update_requested = Signal(int)
    chosen = Signal(int)
    flight_requested = Signal()
    movie_requested = Signal()

    def __init__(self, book: CameraBook, say: Callable[[str], None]) -> None:
        super().__init__()
        self.setAccessibleName("Cameras")
        self._book, self._say = book, say
        self.table = forms.table("Cameras and the path between them", ["Name", "Frame", "Seconds to next"], editable=True)
        self.table.itemChanged.connect(self._edited)
        self.table.itemClicked.connect(lambda item: self.chosen.emit(item.row()))
        keep_keys(self.table, TYPING)
        self._hint = forms.label("Move the camera in the 3D view, then add it. Two or more cameras make a path.", secondary=True)
        add = GlyphButton("plus", "Add the present camera", clicked=self.add_requested.emit)
        remove = GlyphButton("cross", "Remove the chosen camera", clicked=lambda: book.remove(self.current()))
        up = GlyphButton("up", "Earlier", clicked=lambda: self.refresh(book.move(self.current(), -1)))
        down = GlyphButton("down", "Later", clicked=lambda: self.refresh(book.move(self.current(), 1)))
        tip = "Put the present camera and frame into the chosen row"
        update = forms.button("Update", lambda: self.update_requested.emit(self.current()), tip)
        self._fly = forms.button("Fly along", self.flight_requested.emit, "Move the 3D view along the path; again to stop")
        movie = forms.button("Movie…", self.movie_requested.emit, "Save a movie along the path")
        self._of_row, self._of_path = (remove, up, down, update), (self._fly, movie)
        top = forms.row(add, remove, up, down, 0, update, self._fly, movie, spacing=4)
        forms.column(top, self._hint, (self.table, 1), parent=self)
        self.table.itemSelectionChanged.connect(self._enable)
        book.changed.connect(lambda record: self.refresh())
        self.refresh()

    def refresh(self, current: int | None = None) -> None:
        """List the stops, and choose one; the last has no way to a next one."""
        current, rows = self.current() if current is None else current, self._book.stops
        self.table.blockSignals(True)
        self.table.setRowCount(len(rows))
        for i, stop in enumerate(rows):
            last = i == len(rows) - 1
            for column, text in enumerate((stop.name, f"{stop.frame:g}", "" if last else f"{stop.seconds:g}")):
                item = QTableWidgetItem(text)
                if column == _FRAME or (column == _SECONDS and last):
                    item.setFlags(item.flags() & ~Qt.ItemFlag.ItemIsEditable)
                self.table.setItem(i, column, item)
        if rows and current >= 0:
            self.table.selectRow(min(current, len(rows) - 1))
        self.table.blockSignals(False)
        self._hint.setVisible(len(rows) < 2)
        self._enable()

    def current(self) -> int:
        """The chosen row, −1 for none."""
        rows = self.table.selectionModel().selectedRows()
        return rows[0].row() if rows else -1

    def set_flying(self, flying: bool) -> None:
        self._fly.setText("Stop" if flying else "Fly along")

    def _enable(self) -> None:
        chosen, path = self.current() >= 0, self.table.rowCount() > 1
        for button in self._of_row:
            button.setEnabled(chosen)
        for button in self._of_path:
            button.setEnabled(path)

    def _edited(self, item: QTableWidgetItem) -> None:
        """Take what was typed, or show the old text again."""
        try:
            typed = {"name": item.text().strip()} if item.column() == _NAME else {"seconds": float(item.text().replace(",", "."))}
            self._book.change(item.row(), **typed)
        except ValueError:
            self._say(f"A stop has a name and a duration of up to {LONGEST_SECONDS:g} s.")
            self.refresh()
