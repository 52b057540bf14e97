"""The table of everything the window can do."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from app.actions import Action, ActionRegistry
from app.exports import FORMATS
from app.look import Compare

if TYPE_CHECKING:
    from app.window.main import MainWindow

#: Keys 1 to 7, in the order of the layer list.
LAYER_KEYS = (
    ("rgb", "Colour"),
    ("depth", "Depth"),
    ("features", "Features"),
    ("similarity", "Similarity"),
    ("mask", "Masks"),
    ("displacement", "Displacement"),
    ("warp", "Spurious warp"),
    ("support", "Motion support"),
)
COMPARES: tuple[tuple[Compare, str], ...] = (("off", "Compare: off"), ("wipe", "Compare: wipe"), ("difference", "Compare: difference"))


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    """Register the window's actions."""
    _file(registry, window)
    _edit(registry, window)
    _view(registry, window)
    _play(registry, window)
    _train_and_help(registry, window)


def _file(registry: ActionRegistry, window: MainWindow) -> None:
    opening, exporting, session = window.opening, window.exporting, window.session

    export = ("File", "Export")

    def has_scene() -> bool:
        return session.scene is not None

    registry.add(
        Action("file.open-clip", "Open clip…", opening.ask_for_clip, ("File",), ("Ctrl+O",), help="folder with frames"),
        Action("file.open-video", "Open video…", opening.ask_for_video, ("File",), help="clip from a movie file"),
        Action("file.open-run", "Open run…", opening.ask_for_run, ("File",), ("Ctrl+R",), help="reconstruction scene"),
        Action("file.demo", "Demo", opening.open_demo, ("File",), help="sample example"),
        Action("file.save", "Save view", opening.save_session, ("File",), ("Ctrl+S",), lambda: has_scene() and session.dirty, group=1),
        Action(
            "export.picture",
            "Picture as shown…",
            exporting.ask_for_picture,
            ("File", "Export"),
            ("Ctrl+E",),
            lambda: session.frames > 0,
            group=1,
        ),
        *(
            Action(f"export.{name}", f"{entry.title}…", partial(exporting.ask, name), export, (), has_scene, group=1)
            for name, entry in FORMATS.items()
        ),
        Action("export.stop", "Stop exporting", exporting.cancel, export, (), lambda: window.service.busy("export"), group=2),
        Action("file.quit", "Quit", window.close, ("File",), ("Ctrl+Q",), group=9),
    )


def _edit(registry: ActionRegistry, window: MainWindow) -> None:
    undo = window.session.undo

    def has_scene() -> bool:
        return window.session.scene is not None

    registry.add(
        Action("edit.undo", "Undo", undo.undo, ("Edit",), ("Ctrl+Z",), lambda: undo.undo_name is not None),
        Action("edit.redo", "Redo", undo.redo, ("Edit",), ("Ctrl+Shift+Z", "Ctrl+Y"), lambda: undo.redo_name is not None),
        Action(
            "edit.prompt",
            "Write a prompt",
            window.focus_prompt,
            ("Edit",),
            ("/",),
            lambda: window.session.scene is not None,
            group=1,
            help="search mask",
        ),
    )


def _view(registry: ActionRegistry, window: MainWindow) -> None:
    session, settings, parts = window.session, window.settings, window.parts

    def can_show(layer: str) -> bool:
        if session.scene is None:
            return False
        from engine.layers import LAYERS

        return not LAYERS[layer].missing(session.scene, tuple(prompt.text for prompt in session.look.visible_prompts))

    def has_scene() -> bool:
        return session.scene is not None

    def cycle_compare() -> None:
        names = [name for name, _ in COMPARES]
        session.set_compare(names[(names.index(session.look.compare) + 1) % len(names)])

    def can_compare() -> bool:
        return session.scene is not None and session.scene.clip is not None

    def is_shown(layer: str) -> bool:
        return session.scene is not None and session.look.layer == layer

    def is_compared(name: str) -> bool:
        return session.look.compare == name

    def toggle_camera() -> None:
        session.camera_mode = "free" if session.camera_mode == "surgeon" else "surgeon"

    def more_opacity(step: float) -> None:
        session.set_overlay_opacity(session.look.overlay_opacity + step)

    registry.add(
        *(
            Action(
                f"layer.{name}",
                title,
                partial(session.set_layer, name),
                ("View", "Layer"),
                (str(number),),
                partial(can_show, name),
                partial(is_shown, name),
            )
            for number, (name, title) in enumerate(LAYER_KEYS, 1)
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
            lambda: session.set_masks_shown(not session.look.masks_shown),
            ("View",),
            ("M",),
            has_scene,
            lambda: session.look.masks_shown,
            group=2,
        ),
        Action("masks.more", "More opaque masks", lambda: more_opacity(0.1), ("View",), ("Shift+Up",), has_scene, group=2),
        Action("masks.less", "Less opaque masks", lambda: more_opacity(-0.1), ("View",), ("Shift+Down",), has_scene, group=2),
        Action("view.dark", "Dark theme", window.toggle_theme, ("View",), (), checked=lambda: settings.value.theme == "dark", group=3),
    )


def _play(registry: ActionRegistry, window: MainWindow) -> None:
    session = window.session

    def has_frames() -> bool:
        return session.frames > 1

    registry.add(
        Action("play.toggle", "Play or pause", session.toggle_playing, ("Play",), ("Space",), has_frames, lambda: session.playing),
        Action("play.next", "Next frame", lambda: session.step(1), ("Play",), ("Right",), has_frames, group=1),
        Action("play.previous", "Previous frame", lambda: session.step(-1), ("Play",), ("Left",), has_frames, group=1),
        Action("play.forward", "10 frames on", lambda: session.step(10), ("Play",), ("Shift+Right",), has_frames, group=1),
        Action("play.back", "10 frames back", lambda: session.step(-10), ("Play",), ("Shift+Left",), has_frames, group=1),
        Action("play.first", "First frame", lambda: session.step(-session.frames), ("Play",), ("Home",), has_frames, group=2),
        Action("play.last", "Last frame", lambda: session.step(session.frames), ("Play",), ("End",), has_frames, group=2),
    )


def _train_and_help(registry: ActionRegistry, window: MainWindow) -> None:
    session, training = window.session, window.training
    registry.add(
        Action("train.start", "Start…", training.ask, ("Train",), ("Ctrl+T",), lambda: session.clip is not None and not training.running),
        Action("train.resume", "Resume a stopped training…", training.ask_to_resume, ("Train",), (), lambda: not training.running),
        Action("train.cancel", "Cancel", training.cancel, ("Train",), (), lambda: training.running, group=1, help="stop training"),
        Action("help.palette", "Find an action…", window.show_palette, ("Help",), ("Ctrl+K",), help="command palette"),
        Action("help.keys", "Shortcuts", window.show_cheat_sheet, ("Help",), ("?",), help="cheat sheet keys"),
        Action("help.doctor", "Doctor", window.show_doctor, ("Help",), (), group=1, help="what this machine can do"),
        Action("help.about", "About DeGense", window.show_about, ("Help",), (), group=1),
    )
