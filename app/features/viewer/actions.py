"""What is shown and how."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from degense.app.session.view_state import Compare
from degense.app.shell.actions import Action, ActionRegistry
from degense.app.shell.settings import Theme

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow

#: Name, title and key of the layers, in the order of the layer list.
LAYER_KEYS = (
    ("rgb", "Colour", "1"),
    ("depth", "Depth", "2"),
    ("features", "Features", "3"),
    ("similarity", "Similarity", "4"),
    ("mask", "Masks", "5"),
    ("displacement", "Displacement", "6"),
    ("speed", "Speed", "9"),
    ("rotation", "Rotation", ""),
    ("scale", "Scale change", ""),
    ("warp", "Spurious warp", "7"),
    ("observability", "Motion observability", "8"),
)
COMPARES: tuple[tuple[Compare, str], ...] = (
    ("off", "Compare: off"),
    ("wipe", "Compare: wipe"),
    ("blink", "Compare: blink"),
    ("difference", "Compare: difference"),
)


THEME_TITLES: tuple[tuple[Theme, str], ...] = (("dark", "Dark"), ("light", "Light"), ("system", "As the desktop"))


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    session, settings, parts = window.session, window.settings, window.parts

    def can_show(layer: str) -> bool:
        if session.scene is None:
            return False
        from degense.engine.layers import LAYERS

        return not LAYERS[layer].missing(session.scene, tuple(prompt.text for prompt in session.view_state.visible_prompts))

    def has_scene() -> bool:
        return session.scene is not None

    def cycle_compare() -> None:
        names = [name for name, _ in COMPARES]
        session.set_compare(names[(names.index(session.view_state.compare) + 1) % len(names)])

    def can_compare() -> bool:
        return session.scene is not None and session.scene.clip is not None

    def is_shown(layer: str) -> bool:
        return session.scene is not None and session.view_state.layer == layer

    def is_compared(name: str) -> bool:
        return session.view_state.compare == name

    def is_theme(name: str) -> bool:
        return settings.value.theme == name

    def toggle_camera() -> None:
        session.camera_mode = "free" if session.camera_mode == "surgeon" else "surgeon"

    def more_opacity(step: float) -> None:
        session.set_overlay_opacity(session.view_state.overlay_opacity + step)

    registry.add(
        *(
            Action(
                f"layer.{name}",
                title,
                partial(session.set_layer, name),
                ("View", "Layer"),
                (key,) if key else (),
                partial(can_show, name),
                partial(is_shown, name),
            )
            for name, title, key in LAYER_KEYS
        ),
        *(
            Action(
                f"compare.{name}",
                title,
                partial(session.set_compare, name),
                ("View", "Compare"),
                (),
                can_compare,
                partial(is_compared, name),
                help="recorded frame",
            )
            for name, title in COMPARES
        ),
        Action("compare.next", "Next way to compare", cycle_compare, ("View", "Compare"), ("C",), can_compare, group=1),
        Action(
            "camera.free",
            "Look around freely",
            toggle_camera,
            ("View",),
            ("V",),
            lambda: has_scene() and parts.splats is not None,
            lambda: session.camera_mode == "free",
            group=1,
            help="3D camera surgeon's view",
        ),
        Action("view.fit", "Fit the picture", parts.panel.fit, ("View",), ("F",), lambda: session.frames > 0, group=1, help="zoom"),
        Action(
            "masks.shown",
            "Show masks",
            lambda: session.set_masks_shown(not session.view_state.masks_shown),
            ("View",),
            ("M",),
            has_scene,
            lambda: session.view_state.masks_shown,
            group=2,
        ),
        Action("masks.more", "More opaque masks", lambda: more_opacity(0.1), ("View",), ("Shift+Up",), has_scene, group=2),
        Action("masks.less", "Less opaque masks", lambda: more_opacity(-0.1), ("View",), ("Shift+Down",), has_scene, group=2),
        *(
            Action(
                f"theme.{name}",
                title,
                partial(window.preferring.set_theme, name),
                ("View", "Theme"),
                checked=partial(is_theme, name),
                help="colours dark light operating room",
            )
            for name, title in THEME_TITLES
        ),
    )
