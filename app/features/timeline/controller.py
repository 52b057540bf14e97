"""The instant: the timeline under the views, how time runs, and the keys that move it."""

from __future__ import annotations

from degense.app.session.cursor import Playback
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell
from degense.widgets.timeline import Timeline


class TimeControl:
    """Binds the timeline and the session's instant, both ways. The timeline is the clock while time runs."""

    def __init__(self, shell: Shell) -> None:
        self.shell, self.session, self.settings = shell, shell.session, shell.settings
        self.timeline, self.playback = Timeline(), Playback()
        self.session.register("playback", self.playback)
        shell.docks.add_below(self.timeline)
        session, timeline = self.session, self.timeline
        timeline.frame_changed.connect(session.go_to)
        timeline.playing_changed.connect(lambda playing: session.play() if playing else session.pause())
        timeline.speed_changed.connect(lambda speed: self.settings.update(speed=speed))
        timeline.loop_mode_changed.connect(self.playback.set_mode)
        timeline.set_speed(self.settings.value.speed)
        session.frame_changed.connect(timeline.set_frame)
        session.playing_changed.connect(self._follow_playing)
        session.opened.connect(self._opened)
        self.playback.changed.connect(lambda record: self._show_playback())
        self._add_actions()

    def _opened(self) -> None:
        scene, clip = self.session.scene, self.session.clip
        self.timeline.set_frames(self.session.frames, scene.fps if scene else clip.fps if clip else 25.0)
        self.timeline.track.set_marks(clip.test_frames if clip else (), {"labels of the clip": clip.labelled_frames if clip else ()})
        self._show_playback()

    def _show_playback(self) -> None:
        self.timeline.set_loop_mode(self.playback.mode)
        self.timeline.set_played(self.playback.first, self.playback.last)
        self.shell.refresh()

    def _follow_playing(self, playing: bool) -> None:
        if playing != self.timeline.is_playing():
            self.timeline.play() if playing else self.timeline.pause()

    def _add_actions(self) -> None:
        session, playback, menu = self.session, self.playback, ("Play",)

        def has_frames() -> bool:
            return session.frames > 1

        def step(action_id: str, title: str, key: str, frames: int, group: int = 1) -> Action:
            return Action(action_id, title, lambda: session.step(frames), menu, (key,), has_frames, group=group)

        self.shell.add_actions(
            Action("play.toggle", "Play or pause", session.toggle_playing, menu, ("Space",), has_frames, lambda: session.playing),
            step("play.next", "Next frame", "Right", 1),
            step("play.previous", "Previous frame", "Left", -1),
            step("play.forward", "10 frames on", "Shift+Right", 10),
            step("play.back", "10 frames back", "Shift+Left", -10),
            Action("play.first", "First frame", lambda: session.step(-session.frames), menu, ("Home",), has_frames, group=2),
            Action("play.last", "Last frame", lambda: session.step(session.frames), menu, ("End",), has_frames, group=2),
            Action("play.from", "Play from here", lambda: playback.start_at(session.frame), menu, ("I",), has_frames, group=3, help="loop"),
            Action("play.to", "Play up to here", lambda: playback.end_at(session.frame), menu, ("O",), has_frames, group=3, help="loop"),
            Action("play.all", "Play all", playback.play_all, menu, ("Shift+I",), lambda: not playback.whole, group=3, help="loop"),
        )
