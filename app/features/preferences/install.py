"""Edit ▸ Preferences, and View ▸ Theme."""

from __future__ import annotations

from functools import partial

from degense.app.features.preferences.controller import Preferences
from degense.app.shell.actions import Action
from degense.app.shell.settings import Theme
from degense.app.shell.shell import Shell

THEME_TITLES: tuple[tuple[Theme, str], ...] = (("dark", "Dark"), ("light", "Light"), ("system", "As the desktop"))

#: How much text grows or shrinks at once.
STEP = 0.2


def install(shell: Shell) -> None:
    preferences, menu, words = Preferences(shell), ("View", "Theme"), "colours dark light operating room"

    def in_force(theme: Theme) -> bool:
        return shell.settings.value.theme == theme

    shell.provide(preferences)
    shell.add_actions(
        Action(
            "edit.preferences",
            "Preferences…",
            preferences.show,
            ("Edit",),
            ("Ctrl+,",),
            group=9,
            help="settings shortcuts theme 3D background",
        ),
        *(
            Action(
                f"theme.{name}", title, partial(preferences.change, "Theme", theme=name), menu, checked=partial(in_force, name), help=words
            )
            for name, title in THEME_TITLES
        ),
    )
    text, size = ("View", "Text"), preferences.change_text_size
    shell.add_actions(
        Action("text.larger", "Larger text", partial(size, STEP), text, ("Ctrl+Alt+=",), help="font size zoom readable"),
        Action("text.smaller", "Smaller text", partial(size, -STEP), text, ("Ctrl+Alt+-",), help="font size"),
        Action("text.usual", "Usual text", lambda: size(1.0 - shell.settings.value.text_size), text, help="font size reset"),
    )
    shell.started.connect(preferences.take_shortcuts)
