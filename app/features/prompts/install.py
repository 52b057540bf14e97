"""Prompts: the bar, their statistics, and the query of the whole clip."""

from __future__ import annotations

from degense.app.features.prompts.controller import PromptControls
from degense.app.features.prompts.prompt_statistics import QUERY, PromptStatistics
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    controls, viewer = PromptControls(shell), shell.service(Viewer)
    shell.provide(controls)
    shell.add_actions(
        Action("edit.prompt", "Write a prompt", controls.focus, ("Edit",), ("/",), shell.session.has_scene, group=1, help="search mask")
    )
    if viewer is None:
        return
    for channel, urgency in (("answers", 30), ("areas", 85), (QUERY, 80)):
        shell.worker.add_channel(channel, urgency)
    query, menu, words = PromptStatistics(viewer, controls.bar), ("Inspect",), "prompts label maps masks segment"
    shell.provide(query)
    shell.add_actions(
        Action("query.clip", "Query whole clip", query.ask, menu, ("Q",), query.can_ask, group=3, help="prompts area over time masks"),
        Action("query.save", "Query whole clip into a folder…", query.ask_for_folder, menu, (), query.can_ask, None, 3, words),
        Action("query.stop", "Stop the query", query.stop, menu, (), lambda: query.running, group=3, help="cancel prompts"),
    )
