"""What is shown and how, as actions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import get_args

from PySide6.QtCore import Qt

from degense.app.features.viewer.controller import Viewer
from degense.app.session.view_state import Compare
from degense.app.shell.actions import Action
from degense.app.shell.messages import show_page
from degense.engine.layer_titles import LAYER_TITLES

#: Keys of the layers that have one.
KEYED_LAYERS = ("rgb", "depth", "features", "similarity", "mask", "displacement", "warp", "observability", "speed")
LAYER_KEYS = dict(zip(KEYED_LAYERS, "123456789", strict=True))
COMPARES: tuple[Compare, ...] = get_args(Compare)


def add_actions(viewer: Viewer) -> None:
    session, view, state = viewer.session, viewer.session.view, lambda: viewer.session.view_state

    def can_show(layer: str) -> bool:
        if session.scene is None:
            return False
        from degense.engine.layers import LAYERS

        return not LAYERS[layer].missing(session.scene, tuple(prompt.text for prompt in state().visible_prompts))

    def can_compare() -> bool:
        return session.scene is not None and session.scene.clip is not None

    def layer_action(name: str, title: str) -> Action:
        keys = (LAYER_KEYS[name],) if name in LAYER_KEYS else ()
        run, can = partial(view.set_layer, name), partial(can_show, name)
        return Action(f"layer.{name}", title, run, ("View", "Layer"), keys, can, lambda: session.has_scene() and state().layer == name)

    def compare_action(name: Compare) -> Action:
        run, menu = partial(view.set_compare, name), ("View", "Compare")
        title, chosen = name.capitalize(), lambda: state().compare == name
        return Action(f"compare.{name}", title, run, menu, (), can_compare, chosen, help="recorded frame")

    viewer.shell.add_actions(
        *(layer_action(*entry) for entry in LAYER_TITLES.items()),
        *(compare_action(name) for name in COMPARES),
        Action("compare.next", "Next way to compare", partial(_next_compare, viewer), ("View", "Compare"), ("C",), can_compare, group=1),
    )
    _add_view_actions(viewer)


def _add_view_actions(viewer: Viewer) -> None:
    session, view, menu = viewer.session, viewer.session.view, ("View",)

    def full_screen() -> None:
        viewer.shell.setWindowState(viewer.shell.windowState() ^ Qt.WindowState.WindowFullScreen)

    def zoom(factor: float) -> None:
        viewer.panel.zoom.set_factor(viewer.panel.zoom.factor() * factor)

    def zoom_action(name: str, title: str, run: Callable[[], None], *keys: str) -> Action:
        return Action(f"view.{name}", title, run, ("View", "Zoom"), keys, lambda: session.frames > 0, help="zoom")

    def more_opacity(step: float) -> None:
        view.set_overlay_opacity(session.view_state.overlay_opacity + step)

    viewer.shell.add_actions(
        Action(
            "camera.free",
            "Free camera",
            viewer.toggle_free_camera,
            menu,
            ("V",),
            lambda: session.has_scene() and viewer.splats is not None,
            lambda: session.camera_mode == "free",
            group=1,
            help="3D camera surgeon's view",
        ),
        Action("view.full-screen", "Full screen", full_screen, menu, ("F11",), checked=viewer.shell.isFullScreen, group=1),
        zoom_action("fit", "Fit the frame", viewer.panel.zoom.fit, "F"),
        zoom_action("in", "Zoom in", partial(zoom, 1.25), "Ctrl++", "Ctrl+="),
        zoom_action("out", "Zoom out", partial(zoom, 0.8), "Ctrl+-"),
        zoom_action("pixels", "Pixels one to one", lambda: viewer.panel.zoom.set_factor(1.0), "Ctrl+0"),
        Action(
            "masks.shown",
            "Show masks",
            lambda: view.set_masks_shown(not session.view_state.masks_shown),
            menu,
            ("M",),
            session.has_scene,
            lambda: session.view_state.masks_shown,
            group=2,
        ),
        Action("masks.more", "More opaque masks", partial(more_opacity, 0.1), menu, ("Shift+Up",), session.has_scene, group=2),
        Action("masks.less", "Less opaque masks", partial(more_opacity, -0.1), menu, ("Shift+Down",), session.has_scene, group=2),
        Action("help.layers", "What the layers show", partial(_show_layer_help, viewer), ("Help",), ("Shift+F1",), help="formula units"),
    )


def _next_compare(viewer: Viewer) -> None:
    viewer.session.view.set_compare(COMPARES[(COMPARES.index(viewer.session.view_state.compare) + 1) % len(COMPARES)])


def _show_layer_help(viewer: Viewer) -> None:
    from degense.app.features.viewer.layer_help import layer_help
    from degense.engine.layers import LAYERS

    scene = viewer.session.scene
    units = {name: layer.unit(scene) for name, layer in LAYERS.items()} if scene is not None else {}
    show_page(viewer.shell, "What the layers show", layer_help(units))
