"""File ▸ Export."""

from __future__ import annotations

from functools import partial

from degense.app.features.export.controller import Exporter
from degense.app.features.export.formats import FORMATS
from degense.app.features.viewer.controller import Viewer
from degense.app.shell.actions import Action
from degense.app.shell.shell import Shell
from degense.engine.annotation.formats import LABEL_FORMATS

LABELS = f"labels segmentation {' '.join(kind.title for kind in LABEL_FORMATS.values())}"


def install(shell: Shell) -> None:
    viewer, session = shell.service(Viewer), shell.session
    if viewer is None:
        return
    exporter, menu = Exporter(viewer), ("File", "Export")
    ask = exporter.ask_for_labels
    shell.provide(exporter)

    def has_3d() -> bool:
        return session.has_scene() and viewer.splats is not None

    shell.add_actions(
        Action("export.picture", "Frame as shown…", exporter.ask_for_frame, menu, ("Ctrl+E",), lambda: session.frames > 0, group=1),
        Action("export.view3d", "3D view as shown…", exporter.ask_for_screenshot, menu, ("Ctrl+Shift+E",), has_3d, None, 1, "screenshot"),
        Action("export.labels", "Masks or annotations…", ask, menu, ("Ctrl+Alt+E",), exporter.has_labels, group=1, help=LABELS),
        *(
            Action(f"export.{name}", f"{entry.title}…", partial(exporter.ask, name), menu, (), session.has_scene, group=1)
            for name, entry in FORMATS.items()
            if name not in LABEL_FORMATS and name != "movie"  # which has a dialog of its own
        ),
        Action("export.stop", "Stop exporting", exporter.cancel, menu, (), lambda: shell.worker.busy("export"), group=2),
    )
