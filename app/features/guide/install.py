"""Help ▸ User guide."""

from __future__ import annotations

from degense.app.features.guide.pages import read_guide
from degense.app.features.guide.window import GuideWindow
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    def show() -> None:
        GuideWindow(read_guide(), shell).show()

    shell.add_actions(
        Action("help.guide", "User guide", lambda: shell.attempt(show), ("Help",), ("F1",), help="manual handbook documentation how to")
    )
