"""The list of cameras: stops of a path, to go to, to edit, to fly along."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from degense.widgets.glyphs import GlyphButton
from degense.widgets.keys import PRESS, TYPING, keep_keys

_NAME, _FRAME, _SECONDS = range(3)


class CameraList(QWidget):
    """Rows of name, frame and seconds to the next row; name and seconds are edited in place.

    Signals
    -------
    add_requested(), remove_requested(row), move_requested(row, step), update_requested(row)
    chosen(row)
        The user wants to see it from there.
    renamed(row, name), timed(row, seconds)
    flight_requested(), movie_requested()
    """

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
        self._table = QTableWidget(0, 3, self)
        self._table.setAccessibleName("Cameras and the path between them")
        self._table.setHorizontalHeaderLabels(["Name", "Frame", "Seconds to next"])
        self._table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self._table.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self._table.setEditTriggers(QAbstractItemView.EditTrigger.DoubleClicked | QAbstractItemView.EditTrigger.EditKeyPressed)
        self._table.setShowGrid(False)
        self._table.verticalHeader().hide()
        self._table.verticalHeader().setDefaultSectionSize(self.fontMetrics().height() + 8)
        self._table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        self._table.setTabKeyNavigation(False)
        self._table.itemChanged.connect(self._edited)
        self._table.itemClicked.connect(lambda item: self.chosen.emit(item.row()))
        keep_keys(self._table, TYPING)
        self._hint = QLabel("Move the camera in the 3D view, then add it. Two or more cameras make a path.", self)
        self._hint.setObjectName("secondary")
        self._hint.setWordWrap(True)
        self._add = GlyphButton("plus", "Add the present camera", self)
        self._add.clicked.connect(self.add_requested)
        self._remove = GlyphButton("cross", "Remove the chosen camera", self)
        self._up = GlyphButton("up", "Earlier", self)
        self._down = GlyphButton("down", "Later", self)
        self._update = QPushButton("Update", self)
        self._update.setToolTip("Put the present camera and frame into the chosen row")
        for button, act in (
            (self._remove, self.remove_requested.emit),
            (self._up, lambda row: self.move_requested.emit(row, -1)),
            (self._down, lambda row: self.move_requested.emit(row, 1)),
            (self._update, self.update_requested.emit),
        ):
            button.clicked.connect(lambda _checked=False, act=act: act(self.current()))
        self._fly = QPushButton("Fly along", self)
        self._fly.setToolTip("Move the 3D view along the path; again to stop")
        self._fly.clicked.connect(self.flight_requested)
        self._movie = QPushButton("Movie…", self)
        self._movie.setToolTip("Save a movie along the path")
        self._movie.clicked.connect(self.movie_requested)
        for button in (self._update, self._fly, self._movie):
            keep_keys(button, PRESS)
        top = QHBoxLayout()
        top.setSpacing(4)
        for button in (self._add, self._remove, self._up, self._down):
            top.addWidget(button)
        top.addStretch(1)
        for button in (self._update, self._fly, self._movie):
            top.addWidget(button)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 6, 6, 6)
        layout.setSpacing(6)
        layout.addLayout(top)
        layout.addWidget(self._hint)
        layout.addWidget(self._table, 1)
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
        cells = [[self._table.item(row, column) for column in range(3)] for row in range(self._table.rowCount())]
        return [tuple(item.text() for item in row if item is not None) for row in cells]

    def current(self) -> int:
        """The chosen row, −1 for none."""
        rows = self._table.selectionModel().selectedRows()
        return rows[0].row() if rows else -1

    def set_flying(self, flying: bool) -> None:
        self._fly.setText("Stop" if flying else "Fly along")

    def _enable(self) -> None:
        chosen, path = self.current() >= 0, self._table.rowCount() > 1
        for button in (self._remove, self._up, self._down, self._update):
            button.setEnabled(chosen)
        for button in (self._fly, self._movie):
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
