"""Prompts: the bar, their statistics, the query of the whole clip, and the moments that answer questions."""

from __future__ import annotations

from functools import partial

from degense.app.features.prompts.controller import PromptControls
from degense.app.features.prompts.moments import MOMENTS, MomentList
from degense.app.features.prompts.prompt_statistics import QUERY, PromptStatistics
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell

#: How many prompts, from the first, have a key that shows and hides them.
KEYED_PROMPTS = 9


def _toggle(controls: PromptControls, place: int) -> Action:
    run, can, shown = partial(controls.toggle, place), partial(controls.can_toggle, place), partial(controls.is_shown, place)
    key, menu = f"Alt+{place + 1}", ("View", "Prompts")
    return Action(f"prompts.show-{place + 1}", f"Prompt {place + 1}", run, menu, (key,), can, shown, help="show hide mask eye")


def install(shell: Shell) -> None:
    controls, viewer = PromptControls(shell), shell.service(Viewer)
    shell.provide(controls)
    shell.add_actions(
        Action(
            "edit.example",
            "Find what looks like the followed place",
            controls.add_example,
            ("Edit",),
            ("X",),
            controls.can_add_example,
            group=1,
            help="visual example click point prompt similar",
        ),
        Action("edit.prompt", "Write a prompt", controls.focus, ("Edit",), ("/",), shell.session.has_scene, group=1, help="search mask"),
        *(_toggle(controls, place) for place in range(KEYED_PROMPTS)),
    )
    if viewer is None:
        return
    for channel, urgency in (("answers", 30), ("areas", 85), (QUERY, 80), (MOMENTS, 75)):
        shell.worker.add_channel(channel, urgency)
    query, menu, words = PromptStatistics(viewer, controls.bar), ("Inspect",), "prompts label maps masks segment"
    moments = MomentList(viewer)
    shell.provide(query)
    shell.provide(moments)
    shell.add_actions(
        Action("query.clip", "Query whole clip", query.ask, menu, ("Q",), query.can_ask, group=3, help="prompts area over time masks"),
        Action("query.save", "Query whole clip into a folder…", query.ask_for_folder, menu, (), query.can_ask, None, 3, words),
        Action("query.stop", "Stop the query", query.stop, menu, (), lambda: query.running, group=3, help="cancel prompts"),
        Action("query.next", "Next moment", partial(moments.go_on, 1), menu, ("J",), moments.listed, group=3, help="questions jump"),
        Action("query.previous", "Previous moment", partial(moments.go_on, -1), menu, ("Shift+J",), moments.listed, group=3),
    )
