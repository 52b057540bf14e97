"""Opening, saving, exporting."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from degense.app.features.export.formats import FORMATS
from degense.app.shell.actions import Action, ActionRegistry

if TYPE_CHECKING:
    from degense.app.shell.main_window import MainWindow


def fill(registry: ActionRegistry, window: MainWindow) -> None:
    opening, exporting, session = window.opening, window.exporting, window.session

    export = ("File", "Export")

    def has_scene() -> bool:
        return session.scene is not None

    def is_clip() -> bool:
        return session.scene is None and session.clip is not None

    registry.add(
        Action("file.open-clip", "Open clip…", opening.ask_for_clip, ("File",), ("Ctrl+O",), help="folder with frames"),
        Action("file.open-video", "Open video…", opening.ask_for_video, ("File",), help="clip from a movie file"),
        Action("file.open-run", "Open run…", opening.ask_for_run, ("File",), ("Ctrl+R",), help="reconstruction scene"),
        Action(
            "file.check", "Check the clip…", opening.check, ("File",), ("Ctrl+I",), is_clip, help="import masks focal length poses depth"
        ),
        Action("file.demo", "Demo", opening.open_demo, ("File",), help="sample example"),
        Action("file.save", "Save view", window.keeping.save, ("File",), ("Ctrl+S",), lambda: has_scene() and session.dirty, group=1),
        Action(
            "export.picture",
            "Picture as shown…",
            exporting.ask_for_picture,
            ("File", "Export"),
            ("Ctrl+E",),
            lambda: session.frames > 0,
            group=1,
        ),
        Action(
            "export.view3d",
            "3D view as shown…",
            exporting.ask_for_screenshot,
            ("File", "Export"),
            ("Ctrl+Shift+E",),
            lambda: has_scene() and window.parts.splats is not None,
            group=1,
            help="screenshot",
        ),
        *(
            Action(f"export.{name}", f"{entry.title}…", partial(exporting.ask, name), export, (), has_scene, group=1)
            for name, entry in FORMATS.items()
        ),
        Action("export.stop", "Stop exporting", exporting.cancel, export, (), lambda: window.service.busy("export"), group=2),
        Action("file.quit", "Quit", window.close, ("File",), ("Ctrl+Q",), group=9),
    )
