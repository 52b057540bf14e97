"""Menus and shortcuts made from the action table."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from PySide6.QtCore import QObject
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMainWindow, QMenu

from degense.app.shell.actions import Action, ActionRegistry
from degense.engine.errors import DegenseError

#: Left to right in the menu bar; entries of other menus come after them.
ORDER = ("File", "Edit", "View", "Inspect", "Annotate", "Play", "Train", "Help")


class Menus(QObject):
    """One QAction for each entry of the table. `refresh` brings titles, ticks and enabled states up to date."""

    def __init__(self, registry: ActionRegistry, window: QMainWindow, complain: Callable[[str], None]) -> None:
        super().__init__(window)
        self._registry, self._window, self._complain = registry, window, complain
        self._menus: dict[tuple[str, ...], QMenu] = {}
        self._groups: dict[tuple[str, ...], int] = {}
        registry.arrange(ORDER)
        self.actions: dict[str, QAction] = {action.id: self._add(action) for action in registry}
        self.refresh()

    def menu(self, path: tuple[str, ...]) -> QMenu:
        """The menu at a path, made when it is not there yet."""
        if path not in self._menus:
            if len(path) > 1:
                self._menus[path] = self.menu(path[:-1]).addMenu(path[-1])
            else:  # Alt with the first letter opens it; those of `ORDER` differ
                self._menus[path] = self._window.menuBar().addMenu(f"&{path[0]}")
        return self._menus[path]

    def refresh(self) -> None:
        for entry in self._registry:
            action = self.actions[entry.id]
            action.setEnabled(entry.enabled())
            if entry.checked is not None:
                action.setChecked(entry.checked())

    def rebind(self) -> None:
        """Take the registry's shortcuts as they are now."""
        for action_id, action in self.actions.items():
            action.setShortcuts([QKeySequence(key) for key in self._registry.keys(action_id)])

    def list_panels(self, switches: Iterable[QAction]) -> None:
        """View ▸ Panels: each opens and closes one."""
        panels = self.menu(("View", "Panels"))
        for switch in switches:
            panels.addAction(switch)

    def name_undo(self, undo: str | None, redo: str | None) -> None:
        """Say what would be undone and redone."""
        for action, name, verb in (("edit.undo", undo, "Undo"), ("edit.redo", redo, "Redo")):
            if action in self.actions:
                self.actions[action].setText(f"{verb}: {name}" if name else verb)

    def _add(self, entry: Action) -> QAction:
        action = QAction(entry.title, self._window)
        action.setObjectName(entry.id)
        action.setShortcuts([QKeySequence(key) for key in self._registry.keys(entry.id)])
        action.setCheckable(entry.checked is not None)
        action.triggered.connect(lambda: self.run(entry.id))
        if entry.menu:
            menu = self.menu(entry.menu)
            last = self._groups.get(entry.menu, entry.group)
            if last != entry.group:
                menu.addSeparator()
            self._groups[entry.menu] = entry.group
            menu.addAction(action)
        else:
            self._window.addAction(action)
        return action

    def run(self, action_id: str) -> None:
        """Do it, and say why when it cannot be done."""
        try:
            self._registry.run(action_id)
        except DegenseError as error:
            self._complain(str(error))
        self.refresh()
