"""File ▸ Export: the window's way to `app.features.export.formats`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject
from PySide6.QtWidgets import QFileDialog

from degense.app.features.export.formats import FORMATS, ExportOptions
from degense.app.features.viewer.controller import Drawing
from degense.app.features.viewer.pictures import get_layer, with_colour_bar, write_png
from degense.app.session.session import Session
from degense.app.shell.background import write_in_worker
from degense.app.shell.messages import show_error
from degense.app.shell.parts import Parts
from degense.app.shell.worker import RenderService
from degense.engine.errors import DegenseError


class Exporting(QObject):
    """Asks where to, then exports in the worker while the window goes on."""

    def __init__(self, session: Session, service: RenderService, parts: Parts, drawing: Drawing) -> None:
        super().__init__(parts)
        self.session, self.service, self.parts, self.drawing = session, service, parts, drawing

    def ask_for_picture(self) -> None:
        name = f"{self.session.name}-{self.session.view_state.layer}-{self.session.frame:06d}.png"
        file, _ = QFileDialog.getSaveFileName(self.parts.window, "Export picture", name, "PNG (*.png)")
        if file:
            self.save_picture(Path(file))

    def save_picture(self, path: Path) -> None:
        """The picture as it is shown, with its colour bar, as PNG."""
        self._write(path, self.parts.panel.grab_image())

    def _write(self, path: Path, picture: np.ndarray) -> None:
        view = self.drawing.view
        if view is not None and view.span is not None:
            title = get_layer(self.session.view_state.layer).title
            picture = with_colour_bar(picture, title, view.unit, *view.span, view.cmap, hatched=bool(view.uncertain))
        try:
            write_png(path, picture)
        except DegenseError as error:
            show_error(self.parts.window, str(error))
        else:
            self.parts.say(f"Saved {path}")

    def ask_for_screenshot(self) -> None:
        name = f"{self.session.name}-3d-{self.session.view_state.layer}-{self.session.frame:06d}.png"
        file, _ = QFileDialog.getSaveFileName(self.parts.window, "Export 3D view", name, "PNG (*.png)")
        if file:
            self.save_screenshot(Path(file))

    def save_screenshot(self, path: Path) -> None:
        """The 3D view as it is seen, with its colour bar, as PNG."""
        assert self.parts.splats is not None
        self._write(path, self.parts.splats.screenshot_image())

    def ask(self, name: str) -> None:
        """Ask where to write a format, and write it there."""
        chosen = FORMATS[name]
        proposal = f"{self.session.name}-{name}{chosen.suffix}"
        filter_ = f"*{chosen.suffix}" if chosen.suffix else ""
        file, _ = QFileDialog.getSaveFileName(self.parts.window, chosen.title, proposal, filter_)
        if file:
            self.export(name, Path(file))

    def export(self, name: str, out: Path) -> None:
        """Write a format to `out` in the worker. Masks are those of the visible prompts, or of all classes when there are none."""
        scene, view_state, view = self.session.scene, self.session.view_state, self.drawing.view
        assert scene is not None
        options = ExportOptions(
            prompt_set=view_state.prompt_set,
            frame=self.session.frame,
            layer=view_state.layer,
            span=view.span if view is not None else None,
            source="masks",
        )
        write_in_worker(self.service, self.parts, f"Exporting {out.name}", lambda: FORMATS[name].export(scene, out, options))

    def cancel(self) -> None:
        self.service.cancel("export")
        self.parts.set_busy()
        self.parts.say("Export stopped.")
