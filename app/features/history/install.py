"""Undo, redo, and the list of edits: what was done, what is undone, and a click to go there."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtWidgets import QListWidget, QWidget

from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell
from degense.widgets.keys import ARROWS, PRESS, keep_keys

START = "As opened"


class HistoryList(QListWidget):
    """Named states, the oldest first. Those that are undone are grey, and the current one is selected."""

    position_chosen = Signal(int)  # (position) the user wants `position` entries done; 0 is the state before all of them

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName("History")
        self.setToolTip("Click an entry to undo or redo up to it")
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        keep_keys(self, ARROWS | PRESS)
        for wanted in (self.itemClicked, self.itemActivated):
            wanted.connect(lambda item: self.position_chosen.emit(self.row(item)))
        self.set_entries((), 0)

    def set_entries(self, entries: Sequence[str], position: int) -> None:
        """Show these entries, of which the first `position` are done."""
        names = [START, *entries]
        while self.count() > len(names):
            self.takeItem(self.count() - 1)
        self.addItems(names[self.count() :])
        for row, name in enumerate(names):
            item = self.item(row)
            item.setText(name)
            undone = row > position
            font = item.font()
            font.setItalic(undone)
            item.setFont(font)
        self.setCurrentRow(position)
        self.scrollToItem(self.item(position))
        self._colour()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange:
            self._colour()

    def _colour(self) -> None:
        colours = self.palette()
        for row in range(self.count()):
            item = self.item(row)
            item.setForeground(colours.placeholderText() if item.font().italic() else colours.text())


def install(shell: Shell) -> None:
    undo, history = shell.session.undo, HistoryList()
    history.position_chosen.connect(undo.go_to)
    undo.changed.connect(lambda: history.set_entries(undo.entries, undo.position))
    dock = shell.add_dock("History", history)
    menu = ("Edit",)
    shell.add_actions(
        Action("edit.undo", "Undo", undo.undo, menu, ("Ctrl+Z",), lambda: undo.undo_name is not None),
        Action("edit.redo", "Redo", undo.redo, menu, ("Ctrl+Shift+Z", "Ctrl+Y"), lambda: undo.redo_name is not None),
        Action("edit.history", "History", lambda: shell.panes.enter(dock), menu, ("Ctrl+H",), help="list of edits undo"),
    )
