"""What is shown and how, as actions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, get_args

from PySide6.QtCore import Qt

from degense.app.features.viewer.controller import Viewer
from degense.app.session.view_state import Compare
from degense.app.shell.actions import Action
from degense.app.shell.messages import show_page
from degense.engine.layer_titles import LAYER_TITLES
from degense.widgets.splats.splat_camera import CUT

if TYPE_CHECKING:
    from degense.widgets.splats.splat_view import SplatView

#: Keys of the layers that have one.
KEYED_LAYERS = ("rgb", "depth", "features", "similarity", "mask", "displacement", "warp", "observability", "speed")
LAYER_KEYS = dict(zip(KEYED_LAYERS, "123456789", strict=True))
COMPARES: tuple[Compare, ...] = get_args(Compare)
#: How far a key moves the scene in the 3D view, logical pixels.
SHIFT = 32
WAYS = {"left": (-SHIFT, 0), "right": (SHIFT, 0), "up": (0, -SHIFT), "down": (0, SHIFT)}


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
    _add_3d_actions(viewer)


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


def _add_3d_actions(viewer: Viewer) -> None:
    """What the mouse does in the 3D view with Ctrl and the wheel, and with Shift and a drag."""

    def add(name: str, title: str, run: Callable[[SplatView], None], key: str, words: str) -> None:
        def act() -> None:
            if viewer.splats is not None:
                run(viewer.splats)

        def can() -> bool:
            return viewer.session.has_scene() and viewer.splats is not None

        viewer.shell.add_actions(Action(f"view3d.{name}", title, act, ("View", "In 3D"), (key,), can, group=-1, help=f"3D {words}"))

    words = "clip plane section open near inside"
    add("cut-more", "Cut away more of what is near", lambda splats: splats.cut(CUT), "Ctrl+PgDown", words)
    add("cut-less", "Cut away less of what is near", lambda splats: splats.cut(-CUT), "Ctrl+PgUp", words)
    add("cut-nothing", "Cut nothing away", lambda splats: splats.uncut(), "Ctrl+Shift+PgUp", words)
    for way, (x, y) in WAYS.items():
        run = partial(_shift, x=x, y=y)
        add(f"move-{way}", f"Move the scene {way}", run, f"Ctrl+Shift+{way.capitalize()}", "pan camera shift")


def _shift(splats: SplatView, x: float, y: float) -> None:
    splats.camera.shift(x, y)


def _next_compare(viewer: Viewer) -> None:
    viewer.session.view.set_compare(COMPARES[(COMPARES.index(viewer.session.view_state.compare) + 1) % len(COMPARES)])


def _show_layer_help(viewer: Viewer) -> None:
    from degense.app.features.viewer.layer_help import layer_help
    from degense.engine.layers import LAYERS

    scene = viewer.session.scene
    units = {name: layer.unit(scene) for name, layer in LAYERS.items()} if scene is not None else {}
    show_page(viewer.shell, "What the layers show", layer_help(units))
