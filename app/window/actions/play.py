"""The instant."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from app.window.main import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    session = window.session

    def has_frames() -> bool:
        return session.frames > 1

    registry.add(
        Action("play.toggle", "Play or pause", session.toggle_playing, ("Play",), ("Space",), has_frames, lambda: session.playing),
        Action("play.next", "Next frame", lambda: session.step(1), ("Play",), ("Right",), has_frames, group=1),
        Action("play.previous", "Previous frame", lambda: session.step(-1), ("Play",), ("Left",), has_frames, group=1),
        Action("play.forward", "10 frames on", lambda: session.step(10), ("Play",), ("Shift+Right",), has_frames, group=1),
        Action("play.back", "10 frames back", lambda: session.step(-10), ("Play",), ("Shift+Left",), has_frames, group=1),
        Action("play.first", "First frame", lambda: session.step(-session.frames), ("Play",), ("Home",), has_frames, group=2),
        Action("play.last", "Last frame", lambda: session.step(session.frames), ("Play",), ("End",), has_frames, group=2),
    )
