"""File ▸ Export ▸ Report: pictures, curves, tables and provenance in one file."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PySide6.QtCore import QMarginsF, QObject, QSizeF
from PySide6.QtGui import QPageLayout, QPageSize, QPdfWriter, QTextDocument

from degense.app.features.annotate.state import AnnotationState
from degense.app.features.anonymise.anonymity import Anonymity
from degense.app.features.anonymise.file_dialog import FileDialog
from degense.app.features.documents.fact_rows import clip_facts, run_facts
from degense.app.features.events.controller import EventMarks
from degense.app.features.measure.controller import Measuring, with_measures
from degense.app.features.report.contents import Moment, ReportContents, report_page
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.layer_images import get_layer, layer_rgb
from degense.app.features.viewer.view_rendering import layer_request
from degense.app.session.sample import is_demo
from degense.engine.annotation.statistics import ClassCount, class_counts, pixel_counts
from degense.engine.errors import DegenseError
from degense.engine.files import replacing, write_text

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene

#: The most pictures of events.
MOST_PICTURES = 24
KINDS = "Web page (*.html);;PDF (*.pdf)"
HINT = "A web page (.html) or a PDF (.pdf) with pictures, events, measures and where they come from."
MARGIN = 15  # millimetres of a printed page
SHOWN = Anonymity()


class Reporter(QObject):
    """Gathers what the features know and writes it, in the worker but for the printing."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session = viewer, viewer.shell, viewer.session

    def ask(self) -> None:
        scene, clip = self.session.scene, self.session.clip
        opened = scene.run.path if scene is not None else clip.path if clip is not None else Path.home()
        folder = Path.home() if is_demo(opened) else opened.parent
        proposal = folder / f"{self.session.name}-report.html"
        FileDialog(self.shell, "report", "Report", "Export", HINT, KINDS, proposal, "report.html", self.export).open()

    def export(self, path: Path, hidden: Anonymity = SHOWN) -> None:
        """Write a report, as the suffix says. DegenseError for another suffix, or when nothing is open."""
        if path.suffix.lower() not in (".html", ".pdf"):
            raise DegenseError(f"{path.name} must end in .html or .pdf.")
        contents = self.contents(hidden)

        def done(page: str) -> None:
            write_text(path, page) if path.suffix.lower() == ".html" else print_pdf(page, path)
            self.shell.say(f"Saved {path}")

        self.shell.run_task("export", f"Writing {path.name}", lambda: report_page(contents), done)

    def contents(self, hidden: Anonymity = SHOWN) -> ReportContents:
        """What a report says of what is open now. DegenseError when nothing is, or what is covered is not where the view shows it."""
        scene = hidden.scene(self.session.scene) if self.session.scene is not None else None
        clip = hidden.clip(self.session.clip) if self.session.clip is not None else None
        if scene is None and clip is None:
            raise DegenseError("Open a clip or a run first.")
        facts = run_facts(scene) if scene is not None else clip_facts(clip) if clip is not None else []
        marks, measuring = self.shell.service(EventMarks), self.shell.service(Measuring)
        events = marks.state.notes if marks is not None else {}
        noted = [(frame, note) for frame, note in events.items() if frame != self.session.frame][:MOST_PICTURES]
        now = (self.session.frame, events.get(self.session.frame, ""))
        moments = [self._moment(*each, scene, clip, hidden) for each in (now, *noted)]
        return ReportContents(
            scene.name if scene is not None else clip.name if clip is not None else "",
            facts,
            moments,
            measuring.quantities() if measuring is not None else (),
            self._classes(),
            scene.fps if scene is not None else clip.fps if clip is not None else 25.0,
            datetime.now().astimezone().strftime("%d %B %Y, %H:%M"),
            dict(events),
        )

    def _moment(self, frame: int, note: str, scene: Scene | None, clip: Clip | None, hidden: Anonymity) -> Moment:
        """A frame as the layer that is shown draws it; of a clip without a run, as it was recorded."""
        view_state, view = self.session.view_state, self.viewer.view
        measuring = self.shell.service(Measuring)
        measures = measuring.shown(frame) if measuring is not None else []
        if frame == self.session.frame:
            if scene is not None and view is not None:
                hidden.check_camera(view.camera, scene.camera(round(view.frame)))
            grabbed = self.viewer.panel.grab_image()
            picture = hidden.picture(lambda: grabbed)
            return Moment(f"Frame {frame}", note, lambda: with_measures(picture(), measures))
        if scene is None:
            assert clip is not None
            return Moment(f"Frame {frame}", note, partial(clip.frame, frame))
        span = view.span if view is not None and view.span is not None else (0.0, 1.0)
        layer = get_layer(view_state.layer)

        def draw() -> np.ndarray:
            return with_measures(layer_rgb(scene, layer, layer_request(view_state, frame), span), measures)

        return Moment(f"Frame {frame}", note, draw)

    def _classes(self) -> Callable[[], list[tuple[str, ClassCount]]]:
        """Counts how often each class is annotated now; nothing where no frame is labelled."""
        state = self.shell.service(AnnotationState)
        if state is None or state.work is None or not state.labelled_frames():
            return list
        readers = {frame: state.work.reader(frame) for frame in state.labelled_frames()}
        titles = [kind.title for kind in state.work.classes]

        def count() -> list[tuple[str, ClassCount]]:
            return list(
                zip(titles, class_counts({frame: pixel_counts(read()) for frame, read in readers.items()}, len(titles)), strict=True)
            )

        return count


def print_pdf(page: str, out: Path) -> None:
    """Print a page on A4. DegenseError when the file cannot be written."""
    with replacing(out) as temporary:
        writer = QPdfWriter(str(temporary))
        writer.setResolution(96)
        writer.setPageSize(QPageSize(QPageSize.PageSizeId.A4))
        writer.setPageMargins(QMarginsF(MARGIN, MARGIN, MARGIN, MARGIN), QPageLayout.Unit.Millimeter)
        document = QTextDocument()
        document.setHtml(page)
        document.setPageSize(QSizeF(writer.width(), writer.height()))
        document.print_(writer)
        del writer  # it ends the file
