"""The 2D view, the 3D view, the layers, and what the window remembers of them."""

from __future__ import annotations

from degense.app.features.viewer.actions import add_actions
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.guide_switches import GuideSwitches
from degense.app.features.viewer.key_pointer import KeyPointer
from degense.app.features.viewer.layer_controls import LayerControls
from degense.app.features.viewer.window_layout import WindowLayout
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell


def install(shell: Shell) -> None:
    for channel, urgency in (("snapshot", 19), ("view", 20), ("range", 20)):  # a frame is drawn in 3D before its masks are decoded
        shell.worker.add_channel(channel, urgency)
    viewer = Viewer(shell)
    shell.provide(viewer)
    shell.provide(LayerControls(viewer))
    shell.session.register("window", WindowLayout(viewer))
    add_actions(viewer)
    shell.provide(GuideSwitches(viewer))
    pointer = KeyPointer(viewer)
    shell.provide(pointer)
    words, has_frames = "keyboard cursor cross paint click without a mouse", lambda: shell.session.frames > 0
    shell.add_actions(
        Action("view.pointer", "Pointer by keys", pointer.toggle, ("View",), ("Z",), has_frames, lambda: pointer.on, group=1, help=words)
    )
