"""File ▸ Export: the window's way to `app.features.export.formats`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject

from degense.app.features.annotate.label_sets import masks_of_run
from degense.app.features.annotate.state import AnnotationState
from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.export.formats import FORMATS, ExportOptions
from degense.app.features.export.label_dialog import LabelExportDialog
from degense.app.features.export.label_offers import LabelOffer
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.layer_images import get_layer, with_colour_bar, write_png
from degense.engine.annotation.formats import MapSet
from degense.engine.errors import DegenseError


class Exporter(QObject):
    """Asks where to, then exports in the worker while the window goes on."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session = viewer, viewer.shell, viewer.session

    def ask_for_frame(self) -> None:
        self._ask("Export frame", "", self.save_frame)

    def ask_for_screenshot(self) -> None:
        self._ask("Export 3D view", "3d-", self.save_screenshot)

    def _ask(self, title: str, kind: str, save: Callable[[Path], None]) -> None:
        name = f"{self.session.name}-{kind}{self.session.view_state.layer}-{self.session.frame:06d}.png"
        if (path := self.shell.ask_save(title, name, "PNG (*.png)")) is not None:
            save(path)

    def save_frame(self, path: Path) -> None:
        """The frame as it is shown, with its colour bar, as PNG."""
        self._write(path, self.viewer.panel.grab_image())

    def _write(self, path: Path, frame: np.ndarray) -> None:
        view = self.viewer.view
        if view is not None and view.span is not None:
            title = get_layer(view.layer).title
            frame = with_colour_bar(frame, title, view.unit, *view.span, view.cmap, hatched=bool(view.uncertain), outside=view.beyond)

        def save() -> None:
            write_png(path, frame)
            self.shell.say(f"Saved {path}")

        self.shell.attempt(save)

    def save_screenshot(self, path: Path) -> None:
        """The 3D view as it is seen, with its colour bar, as PNG."""
        assert self.viewer.splats is not None
        self._write(path, self.viewer.splats.screenshot_image())

    def ask(self, name: str) -> None:
        chosen = FORMATS[name]
        proposal = f"{self.session.name}-{name}{chosen.suffix}"
        filter_ = f"*{chosen.suffix}" if chosen.suffix else ""
        if (path := self.shell.ask_save(chosen.title, proposal, filter_)) is not None:
            self.export(name, path)

    def ask_for_labels(self, source: str = "") -> None:
        """Open the dialog that exports masks or annotations; without a source the annotations where there are any."""
        state, offers = self.shell.service(AnnotationState), self._label_offers()
        if not offers:
            raise DegenseError("There is nothing to export yet: annotate a frame, or open a run that answers prompts.")
        annotated_frames = state.labelled_frames() if state is not None else ()
        wanted = source or ("annotations" if annotated_frames else "masks")
        LabelExportDialog(self.shell, offers, annotated_frames, wanted if wanted in offers else next(iter(offers))).open()

    def _label_offers(self) -> dict[str, LabelOffer]:
        """What is open and has label maps: annotations, and what the run answers to the visible prompts, else to its own classes."""
        session, state, offers = self.session, self.shell.service(AnnotationState), {}

        def annotated(hidden: Anonymity) -> MapSet:
            assert state is not None
            return hidden.maps(state.snapshot())

        def found(hidden: Anonymity) -> MapSet:
            assert scene is not None
            return masks_of_run(hidden.scene(scene), prompts)

        if state is not None and state.work is not None and state.labelled_frames():
            names = tuple(kind.title for kind in state.work.classes)
            offers["annotations"] = LabelOffer("annotations", names, state.labelled_frames(), annotated)
        if (scene := session.scene) is not None and scene.has_semantics:
            prompts = session.view_state.prompt_set
            title = "masks of the visible prompts" if prompts.prompts else "masks of the classes of the run"
            if names := prompts.prompts or scene.classes:
                offers["masks"] = LabelOffer(title, names, tuple(range(scene.frames)), found)
        return offers

    def has_labels(self) -> bool:
        return bool(self._label_offers())

    def export(self, name: str, out: Path) -> None:
        """Write a format to `out` in the worker. Masks are those of the visible prompts, or of all classes when there are none."""
        scene, view_state, view = self.session.scene, self.session.view_state, self.viewer.view
        assert scene is not None
        options = ExportOptions(
            prompt_set=view_state.prompt_set,
            frame=self.session.frame,
            layer=view_state.layer,
            span=view.spans.get(view_state.layer) if view is not None else None,
            source="masks",
        )
        self.shell.run_task("export", f"Exporting {out.name}", lambda: FORMATS[name].export(scene, out, options))

    def cancel(self) -> None:
        self.shell.worker.cancel("export")
        self.shell.set_busy()
        self.shell.say("Export stopped.")
