"""The instant."""

from __future__ import annotations

from typing import TYPE_CHECKING

from degense.app.shell.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    session, playback = window.session, window.playback

    def has_frames() -> bool:
        return session.frames > 1

    def from_here() -> None:
        playback.start_at(session.frame)

    def up_to_here() -> None:
        playback.end_at(session.frame)

    registry.add(
        Action("play.toggle", "Play or pause", session.toggle_playing, ("Play",), ("Space",), has_frames, lambda: session.playing),
        Action("play.next", "Next frame", lambda: session.step(1), ("Play",), ("Right",), has_frames, group=1),
        Action("play.previous", "Previous frame", lambda: session.step(-1), ("Play",), ("Left",), has_frames, group=1),
        Action("play.forward", "10 frames on", lambda: session.step(10), ("Play",), ("Shift+Right",), has_frames, group=1),
        Action("play.back", "10 frames back", lambda: session.step(-10), ("Play",), ("Shift+Left",), has_frames, group=1),
        Action("play.first", "First frame", lambda: session.step(-session.frames), ("Play",), ("Home",), has_frames, group=2),
        Action("play.last", "Last frame", lambda: session.step(session.frames), ("Play",), ("End",), has_frames, group=2),
        Action("play.from", "Play from here (A)", from_here, ("Play",), ("I",), has_frames, group=3, help="loop"),
        Action("play.to", "Play up to here (B)", up_to_here, ("Play",), ("O",), has_frames, group=3, help="loop"),
        Action("play.all", "Play all", playback.play_all, ("Play",), ("Shift+I",), lambda: not playback.whole, group=3, help="loop"),
    )
