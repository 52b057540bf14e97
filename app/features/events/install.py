"""Marks on the timeline with notes."""

from __future__ import annotations

from functools import partial

from degense.app.features.events.controller import EventMarks
from degense.app.features.timeline.controller import TimeControl
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    time = shell.service(TimeControl)
    if time is None:
        return
    marks, session, menu = EventMarks(shell, time), shell.session, ("Play",)
    shell.provide(marks)

    def has_frames() -> bool:
        return session.frames > 0

    def another(step: int) -> bool:
        return marks.state.next_to(session.frame, step) is not None

    help_words = "note annotation bookmark moment"
    shell.add_actions(
        Action("events.mark", "Mark an event", marks.mark, menu, ("Shift+E",), has_frames, group=4, help=help_words),
        Action("events.next", "Next event", partial(marks.go_on, 1), menu, ("Alt+Right",), partial(another, 1), group=4, help=help_words),
        Action("events.previous", "Previous event", partial(marks.go_on, -1), menu, ("Alt+Left",), partial(another, -1), group=4),
        Action("events.remove", "Remove the chosen event", marks.remove, menu, (), lambda: marks.chosen() is not None, group=4),
    )
