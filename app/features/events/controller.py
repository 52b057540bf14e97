"""Events: marks on the timeline with notes, and their list."""

from __future__ import annotations

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QHeaderView, QTableWidgetItem, QWidget

from degense.app.features.events.state import Events
from degense.app.features.timeline.controller import TimeControl
from degense.app.shell.shell import Shell
from degense.widgets import forms
from degense.widgets.keys import TYPING, keep_keys

HINT = "Play ▸ Mark an event (Shift+E) marks this frame; write what happens there."


class EventMarks(QObject):
    """Shows the events of the session in the timeline and in a list."""

    def __init__(self, shell: Shell, time: TimeControl) -> None:
        super().__init__(shell)
        self.shell, self.session, self.time = shell, shell.session, time
        self.state = Events(self.session.undo)
        panel = QWidget()
        panel.setAccessibleName("Events")
        self.table = forms.table("Events", ["Frame", "Time", "Note"], editable=True)
        for column in (0, 1):
            self.table.horizontalHeader().setSectionResizeMode(column, QHeaderView.ResizeMode.ResizeToContents)
        self.table.currentCellChanged.connect(lambda row, *_: self._go(row))
        self.table.itemChanged.connect(self._noted)
        keep_keys(self.table, TYPING)
        self._hint = forms.label(HINT, secondary=True)
        self.remove_button = forms.button("Remove", self.remove, "Remove the chosen event")
        forms.column(self._hint, (self.table, 1), forms.row(0, self.remove_button), parent=panel)
        self.dock = shell.add_dock("Events", panel)
        self.session.register("events", self.state)
        self.state.changed.connect(lambda record: self._show())
        self.session.opened.connect(self._show)

    def mark(self) -> None:
        """Mark the frame that is shown, and let its note be written."""
        frame = self.session.frame
        self.session.pause()
        if frame not in self.state.notes:
            self.state.put(frame)
        self.shell.docks.bring(self.dock)
        row = list(self.state.notes).index(frame)
        self.table.setFocus()
        self.table.setCurrentCell(row, 2)
        if (item := self.table.item(row, 2)) is not None:
            self.table.editItem(item)

    def chosen(self) -> int | None:
        """The frame of the chosen row."""
        row, frames = self.table.currentRow(), list(self.state.notes)
        return frames[row] if 0 <= row < len(frames) else None

    def remove(self) -> None:
        if (frame := self.chosen()) is not None:
            self.state.remove(frame)

    def go_on(self, step: int) -> None:
        """Go to the next or the previous event."""
        if (frame := self.state.next_to(self.session.frame, step)) is not None:
            self.session.pause()
            self.session.go_to(frame)

    def _go(self, row: int) -> None:
        frames = list(self.state.notes)
        if 0 <= row < len(frames) and frames[row] != self.session.frame:
            self.session.pause()
            self.session.go_to(frames[row])

    def _noted(self, item: QTableWidgetItem) -> None:
        self.state.put(list(self.state.notes)[item.row()], item.text())

    def _show(self) -> None:
        scene, clip = self.session.scene, self.session.clip
        fps = scene.fps if scene is not None else clip.fps if clip is not None else 25.0
        forms.fill(self.table, [(str(frame), f"{frame / fps:.2f} s", note) for frame, note in self.state.notes.items()])
        blocked = self.table.blockSignals(True)
        for row in range(self.table.rowCount()):
            for column in (0, 1):
                if (item := self.table.item(row, column)) is not None:
                    item.setFlags(Qt.ItemFlag.ItemIsSelectable | Qt.ItemFlag.ItemIsEnabled)
        self.table.blockSignals(blocked)
        self._hint.setVisible(not self.state.notes)
        self.remove_button.setEnabled(bool(self.state.notes))
        self.time.timeline.track.set_events(self.state.notes)
        self.shell.refresh()
