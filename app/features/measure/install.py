"""Distances, paths, areas and changes of volume, in the unit of the clip."""

from __future__ import annotations

from functools import partial

from degense.app.features.measure.controller import Measuring
from degense.app.features.measure.state import Kind
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell

KEYS: dict[Kind, str] = {"distance": "Shift+D", "path": "Shift+P", "area": "Shift+A"}
HELP = "ruler length surface volume mm"


def install(shell: Shell) -> None:
    viewer, guides = shell.service(Viewer), shell.service(GuideSwitches)
    if viewer is None or guides is None:
        return
    shell.worker.add_channel("measures", 54)
    measuring, menu, has_scene = Measuring(viewer, guides), ("Inspect", "Measure"), shell.session.has_scene
    shell.provide(measuring)

    def tool(kind: Kind, title: str) -> Action:
        toggle, chosen = partial(measuring.toggle, kind), partial(measuring.has_tool, kind)
        return Action(f"measure.{kind}", title, toggle, menu, (KEYS[kind],), has_scene, chosen, help=HELP)

    shell.add_actions(
        tool("distance", "Measure a distance"),
        tool("path", "Measure along a path"),
        tool("area", "Measure an area and its volume change"),
        Action("measure.remove", "Remove the chosen measure", measuring.remove, menu, (), lambda: measuring.chosen() is not None, group=1),
        Action("measure.export", "Export measures…", measuring.export, menu, (), measuring.can_export, group=1, help="csv table save"),
    )
