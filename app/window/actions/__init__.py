"""Everything the window can do: one file per area, each with a `fill(registry, window)`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.actions import ActionRegistry
from app.window.actions import annotation, asking, cameras, edit, files, help, inspection, play, training, view

if TYPE_CHECKING:
    from app.window.main import MainWindow

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
