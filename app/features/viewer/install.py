"""The 2D view, the 3D view, the layers, and what the window remembers of them."""

from __future__ import annotations

from degense.app.features.viewer.actions import add_actions
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.app.features.viewer.layer_controls import LayerControls
from degense.app.features.viewer.window_layout import WindowLayout
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    for channel in ("view", "snapshot", "range"):
        shell.worker.add_channel(channel, 20)
    viewer = Viewer(shell)
    shell.provide(viewer)
    shell.provide(LayerControls(viewer))
    shell.session.register("window", WindowLayout(viewer))
    add_actions(viewer)
    shell.provide(GuideSwitches(viewer))
