"""Points that are followed: clicked, corrected, compared with files, exported."""

from __future__ import annotations

from degense.app.features.tracks.controller import PointTracking
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    viewer, guides = shell.service(Viewer), shell.service(GuideSwitches)
    if viewer is None or guides is None:
        return
    shell.worker.add_channel("tracks", 53)
    tracking, menu, has_scene = PointTracking(viewer, guides), ("Inspect", "Tracks"), shell.session.has_scene
    shell.provide(tracking)
    add, chosen, any_points = tracking.toggle_adding, lambda: tracking.chosen() is not None, lambda: bool(tracking.state.points)
    shell.add_actions(
        Action("tracks.add", "Track points", add, ("Inspect",), ("T",), has_scene, tracking.is_adding, 2, "follow motion trail"),
        Action("tracks.remove", "Remove the chosen point", tracking.remove, menu, ("Del",), chosen),
        Action("tracks.clear", "Remove all points", tracking.state.remove_all, menu, (), any_points),
        Action("tracks.compare", "Compare with a track file…", tracking.compare, menu, (), has_scene, help="scores truth"),
        Action("tracks.export", "Export tracks…", tracking.export, menu, (), tracking.can_export, help="csv json table"),
    )
