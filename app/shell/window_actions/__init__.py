"""Everything the window can do: one file per area, each with a `fill(registry, window)`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from degense.app.features.annotate import actions as annotation
from degense.app.features.cameras import actions as cameras
from degense.app.features.documents import actions as files
from degense.app.features.inspect import actions as inspection
from degense.app.features.prompts import actions as asking
from degense.app.features.train import actions as training
from degense.app.features.viewer import actions as view
from degense.app.shell.actions import ActionRegistry
from degense.app.shell.window_actions import edit, help, play

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow

#: In the order of the menus.
AREAS = (
    files,
    edit,
    view,
    cameras,
    inspection,
    asking,
    annotation,
    play,
    training,
    help,
)


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    """Register the window's actions."""
    for area in AREAS:
        area.fill(registry, window)
