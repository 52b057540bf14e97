"""Edit ▸ Preferences, themes and shortcuts: what the user has settled, in force at once."""

from __future__ import annotations

import logging
from typing import Any, get_args

from PySide6.QtCore import QObject, Qt, QTimer
from PySide6.QtWidgets import QApplication, QFormLayout, QLabel, QWidget

from degense.app.features.preferences.shortcut_table import ShortcutTable
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.settings import LIMITS, Background, Theme, log_file
from degense.app.shell.shell import Shell
from degense.widgets import forms
from degense.widgets.theme import apply_text_size, apply_theme

log = logging.getLogger(__name__)

THEME_WORDS: tuple[tuple[Theme, str], ...] = (("dark", "Dark, for operating rooms"), ("light", "Light"), ("system", "As the desktop"))


class Preferences(QObject):
    """Applies settings when the window starts and whenever they change."""

    def __init__(self, shell: Shell) -> None:
        super().__init__(shell)
        self.shell, self.registry, self.session, self.settings = shell, shell.registry, shell.session, shell.settings
        self._use_memory()
        QApplication.styleHints().colorSchemeChanged.connect(self._desktop_changed)

    def take_shortcuts(self) -> None:
        """Give the actions the user's keys. Keys that clash, with those of a newer version, are left out and logged."""
        for sentence in self.registry.rebind(self.settings.value.shortcuts):
            log.warning(sentence)
        self.shell.menus.rebind()

    def show(self) -> None:
        """The dialog. Everything in it takes effect at once, so that it has nothing to confirm."""
        PreferencesDialog(self, self.shell).open()

    def keep_shortcuts(self) -> None:
        self.change("Shortcuts", shortcuts={action_id: list(keys) for action_id, keys in self.registry.given.items()})

    def change(self, name: str, **values: Any) -> None:
        """Settle something, as a step that can be undone."""
        before = {key: getattr(self.settings.value, key) for key in values}
        self.session.undo.do(name, self._put, before, values, key=f"preference {name}")

    def change_text_size(self, step: float) -> None:
        """Larger or smaller text, within the limits."""
        least, most = LIMITS["text_size"]
        size = round(min(most, max(least, self.settings.value.text_size + step)), 2)
        if size != self.settings.value.text_size:
            self.change("Text size", text_size=size)
            self.shell.say(f"Text at {size:.0%}")

    def _put(self, values: dict[str, Any]) -> None:
        self.settings.update(**values)
        if "theme" in values:
            self._dress()
        if "text_size" in values:
            apply_text_size(_application(), self.settings.value.text_size)
            QTimer.singleShot(0, self, self.shell.docks.arrange)
        if "background" in values and (viewer := self.shell.service(Viewer)) is not None:
            viewer.set_background()
        if "undo_memory" in values:
            self._use_memory()
        if "shortcuts" in values:
            self.take_shortcuts()
        self.shell.refresh()

    def _use_memory(self) -> None:
        self.session.undo.set_memory(round(self.settings.value.undo_memory * (1 << 20)))

    def _desktop_changed(self, scheme: Qt.ColorScheme) -> None:
        if self.settings.value.theme == "system":
            self._dress()

    def _dress(self) -> None:
        apply_theme(_application(), self.settings.value.theme)


def _application() -> QApplication:
    app = QApplication.instance()
    assert isinstance(app, QApplication)
    return app


class PreferencesDialog(forms.Dialog):
    """What can be settled, and the keys."""

    def __init__(self, preferences: Preferences, parent: QWidget) -> None:
        super().__init__(parent, "preferences", "Preferences", 680, 560)
        settings = preferences.settings.value
        self.theme = forms.choice("Theme", THEME_WORDS)
        self.background = forms.choice("3D background", [(name, name.capitalize()) for name in get_args(Background)])
        self.autosave = forms.decimal("Autosave", *LIMITS["autosave"], 0.5, " min", "only when asked")
        self.undo = forms.decimal("Undo memory", *LIMITS["undo_memory"], 64, " MB", decimals=0)
        self.trainings = forms.decimal("Trainings at once", *LIMITS["trainings_at_once"], 1, "", "what fits", decimals=0)
        self.shortcuts = ShortcutTable(preferences.registry)
        page = QWidget()
        form = QFormLayout(page)
        form.setVerticalSpacing(14)
        for title, control, given, words in (
            ("Theme", self.theme, settings.theme, "Colours of the window."),
            ("3D background", self.background, settings.background, "What is seen between the splats of the 3D view, in every theme."),
            (
                "Autosave",
                self.autosave,
                settings.autosave,
                "How long after a change it is saved. A journal keeps every change in between, also over a crash.",
            ),
            ("Undo memory", self.undo, settings.undo_memory, "What undo may hold; beyond it the oldest steps are forgotten."),
            (
                "Trainings at once",
                self.trainings,
                settings.trainings_at_once,
                "How many of the queue run beside each other and share the cores: by itself one for four cores, or what a GPU holds.",
            ),
        ):
            forms.enter(control, given)
            form.addRow(title, forms.column(control, forms.label(words, secondary=True), margin=0, spacing=3))
        form.addRow("Settings", _selectable(str(preferences.settings.path)))
        form.addRow("Log", _selectable(str(log_file())))
        self.tabs = forms.tabs(General=page, Shortcuts=self.shortcuts)
        forms.column((self.tabs, 1), self.closing(), margin=11, parent=self)
        self.theme.currentIndexChanged.connect(lambda: preferences.change("Theme", theme=self.theme.currentData()))
        self.background.currentIndexChanged.connect(lambda: preferences.change("3D background", background=self.background.currentData()))
        self.autosave.valueChanged.connect(lambda minutes: preferences.change("Autosave", autosave=minutes))
        self.undo.valueChanged.connect(lambda megabytes: preferences.change("Undo memory", undo_memory=megabytes))
        self.trainings.valueChanged.connect(lambda number: preferences.change("Trainings at once", trainings_at_once=number))
        self.shortcuts.changed.connect(preferences.keep_shortcuts)


def _selectable(text: str) -> QLabel:
    label = forms.label(text, secondary=True)
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label
