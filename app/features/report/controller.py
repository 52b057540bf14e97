"""File ▸ Export ▸ Report: pictures, curves, tables and provenance in one file."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np
from PySide6.QtCore import QMarginsF, QObject, QSizeF
from PySide6.QtGui import QPageLayout, QPageSize, QPdfWriter, QTextDocument

from degense.app.features.annotate.state import AnnotationState
from degense.app.features.documents.controller import clip_facts, run_facts
from degense.app.features.events.controller import EventMarks
from degense.app.features.measure.controller import Measuring, with_measures
from degense.app.features.report.contents import Moment, ReportContents, report_page
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.layer_images import get_layer, layer_rgb
from degense.app.features.viewer.view_rendering import layer_request
from degense.engine.annotation.statistics import ClassCount, class_counts, pixel_counts
from degense.engine.errors import DegenseError
from degense.engine.files import replacing, write_text

#: The most pictures of events.
MOST_PICTURES = 24
KINDS = "Web page (*.html);;PDF (*.pdf)"
MARGIN = 15  # millimetres of a printed page


class Reporter(QObject):
    """Gathers what the features know and writes it, in the worker but for the printing."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session = viewer, viewer.shell, viewer.session

    def ask(self) -> None:
        path = self.shell.ask_save("Export a report", f"{self.session.name}-report.html", KINDS)
        if path is not None:
            self.shell.attempt(lambda: self.export(path))

    def export(self, path: Path) -> None:
        """Write a report, as the suffix says. DegenseError for another suffix, or when nothing is open."""
        if path.suffix.lower() not in (".html", ".pdf"):
            raise DegenseError(f"{path.name} must end in .html or .pdf.")
        contents = self.contents()

        def done(page: str) -> None:
            write_text(path, page) if path.suffix.lower() == ".html" else print_pdf(page, path)
            self.shell.say(f"Saved {path}")

        self.shell.run_task("export", f"Writing {path.name}", lambda: report_page(contents), done)

    def contents(self) -> ReportContents:
        """What a report says of what is open now."""
        scene, clip = self.session.scene, self.session.clip
        if scene is None and clip is None:
            raise DegenseError("Open a clip or a run first.")
        facts = run_facts(scene) if scene is not None else clip_facts(clip) if clip is not None else []
        marks, measuring = self.shell.service(EventMarks), self.shell.service(Measuring)
        events = marks.state.notes if marks is not None else {}
        noted = [(frame, note) for frame, note in events.items() if frame != self.session.frame][:MOST_PICTURES]
        moments = [self._moment(self.session.frame, events.get(self.session.frame, "")), *(self._moment(*each) for each in noted)]
        return ReportContents(
            self.session.name,
            facts,
            moments,
            measuring.quantities() if measuring is not None else (),
            self._classes(),
            scene.fps if scene is not None else clip.fps if clip is not None else 25.0,
            datetime.now().astimezone().strftime("%d %B %Y, %H:%M"),
            dict(events),
        )

    def _moment(self, frame: int, note: str) -> Moment:
        """A frame as the layer that is shown draws it; of a clip without a run, as it was recorded."""
        scene, clip, view_state = self.session.scene, self.session.clip, self.session.view_state
        measuring = self.shell.service(Measuring)
        measures = measuring.shown(frame) if measuring is not None else []
        if frame == self.session.frame:
            picture = self.viewer.panel.grab_image()
            return Moment(f"Frame {frame}", note, lambda: with_measures(picture, measures))
        if scene is None:
            assert clip is not None
            return Moment(f"Frame {frame}", note, partial(clip.frame, frame))
        view = self.viewer.view
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
