"""The timeline under the views, and the keys that move time."""

from __future__ import annotations

from degense.app.features.timeline.controller import TimeControl
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    shell.provide(TimeControl(shell))
