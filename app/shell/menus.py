"""Menus and shortcuts made from the action table."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMainWindow, QMenu

from degense.app.shell.actions import Action, ActionRegistry
from degense.app.shell.settings import SettingsFile
from degense.engine.errors import DegenseError


class Menus(QObject):
    """One QAction for each entry of the table. `refresh` brings titles, ticks and enabled states up to date."""

    def __init__(self, registry: ActionRegistry, window: QMainWindow, complain: Callable[[str], None]) -> None:
        super().__init__(window)
        self._registry, self._window, self._complain = registry, window, complain
        self._menus: dict[tuple[str, ...], QMenu] = {}
        self._groups: dict[tuple[str, ...], int] = {}
        self.actions: dict[str, QAction] = {action.id: self._add(action) for action in registry}
        self.refresh()

    def menu(self, path: tuple[str, ...]) -> QMenu:
        """The menu at a path, made when it is not there yet."""
        if path not in self._menus:
            parent = self.menu(path[:-1]) if len(path) > 1 else self._window.menuBar()
            self._menus[path] = parent.addMenu(path[-1])
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

    def add_recent(self, settings: SettingsFile, open_path: Callable[[Path], None]) -> None:
        """File ▸ Recent, filled when it is shown."""
        recent = QMenu("Recent", self._window)
        self.menu(("File",)).insertMenu(self.actions["file.demo"], recent)

        def fill() -> None:
            recent.clear()
            for text in settings.value.recent:
                recent.addAction(text, partial(open_path, Path(text)))
            if not settings.value.recent:
                recent.addAction("Nothing yet").setEnabled(False)

        recent.aboutToShow.connect(fill)

    def _add(self, entry: Action) -> QAction:
        action = QAction(entry.title, self._window)
        action.setObjectName(entry.id)
        action.setShortcuts([QKeySequence(key) for key in self._registry.keys(entry.id)])
        action.setCheckable(entry.checked is not None)
        if entry.help:
            action.setStatusTip(entry.help)
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
