"""A second run beside the first."""

from __future__ import annotations

from degense.app.features.compare.controller import RunComparison
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    viewer = shell.service(Viewer)
    if viewer is None:
        return
    for channel in ("second", "second-view"):
        shell.worker.add_channel(channel, 40)
    comparison, menu, has_scene = RunComparison(viewer), ("Inspect",), shell.session.has_scene
    shell.provide(comparison)

    shell.add_actions(
        Action("inspect.second-run", "Compare with run…", comparison.ask, menu, (), has_scene, group=2, help="side by side second run"),
        Action("inspect.one-run", "Close the other run", comparison.close, menu, (), lambda: comparison.scene is not None, group=2),
    )
