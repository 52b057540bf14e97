"""What is blacked out is shared by all exports."""

from __future__ import annotations

from degense.app.features.anonymise.box import Covers
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    shell.provide(Covers(shell))
