"""Annotating: binds the panel, the frame and the session's label maps."""

from __future__ import annotations

from PySide6.QtCore import QObject

from degense.app.features.annotate.painter import AnnotationKeys, Painter
from degense.app.features.annotate.panel import AnnotationPanel
from degense.app.features.annotate.review import PropagationReview
from degense.app.features.annotate.state import AnnotationState
from degense.app.features.timeline.controller import TimeControl
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.view_rendering import View
from degense.engine.annotation.overlay import label_overlay
from degense.engine.annotation.painting import PixelRegion
from degense.engine.errors import DegenseError


class Annotator(QObject):
    """Shows the annotations of the frame in the panel, over the frame and in the timeline."""

    def __init__(self, viewer: Viewer, state: AnnotationState) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session, self.state = viewer, viewer.shell, viewer.session, state
        self.panel = AnnotationPanel(self.shell, state)
        self.dock = self.shell.add_dock("Annotation", self.panel, "right", hidden=True)
        self.painter = Painter(self.shell, state, viewer.panel)
        self.review = PropagationReview(self.shell, state)
        AnnotationKeys(self.shell, state, self.painter, self.review.go_on)
        state.pixels_changed.connect(self._pixels_changed)
        state.records_changed.connect(self._show_frame)
        state.classes_changed.connect(self.panel.show_classes)
        state.tool.changed.connect(self._show_tool)
        state.tool.active_changed.connect(self._active_changed)
        self.session.opened.connect(self.panel.show_classes)
        self.session.opened.connect(self._frame_changed)
        self.session.frame_changed.connect(lambda frame: self._frame_changed())
        viewer.shown.connect(self._shown)
        self.shell.ticked.connect(state.write_stroke)
        self.shell.leaving.connect(state.end)  # a stroke that has not ended is saved too

    def toggle(self) -> None:
        self.state.tool.active = not self.state.tool.active

    def _active_changed(self, active: bool) -> None:
        if active:
            self.session.pause()
            self.shell.docks.isolate(self.dock, self.viewer.panel)
            self.viewer.panel.setFocus()
            if self.state.blocked:
                self.shell.show_error(self.state.blocked)
        else:
            self.shell.docks.rejoin(self.dock)
        self.viewer.labels = self.state.reader if active else None
        self._show_tool()
        self._frame_changed()
        self.viewer.request()

    def _show_tool(self) -> None:
        self.panel.show_tool()
        self.painter.show_tool()

    def _frame_changed(self) -> None:
        self.painter.end()
        self._show_frame()
        if not self.state.tool.active or self.state.work is None:
            self.viewer.panel.set_labels(None)

    def _show_frame(self) -> None:
        """Describe the frame in the panel, and mark test frames and labelled frames in the timeline."""
        work, clip, time = self.state.work, self.session.clip, self.shell.service(TimeControl)
        self.dock.setEnabled(work is not None)
        self.panel.show_frame(self.session.frame)
        if work is not None and time is not None:
            time.timeline.track.set_marks(clip.test_frames if clip else (), work.kinds(clip.labelled_frames if clip else ()))
        self.shell.refresh()

    # The frame

    def _shown(self, view: View) -> None:
        if self.state.tool.active and view.frame == self.session.frame:
            self._show_pixels(self.session.frame, None)

    def _pixels_changed(self, frame: int, region: PixelRegion | None) -> None:
        if self.state.is_at_hand(frame):  # else they are shown when they have been read
            self._show_pixels(frame, region)

    def _show_pixels(self, frame: int, region: PixelRegion | None) -> None:
        """Lay the labels over the frame, as far as they changed."""
        work = self.state.work
        if work is None or not self.state.tool.active or frame != self.session.frame:
            return
        try:
            labels = self.state.labels(frame)
        except DegenseError as error:  # a damaged file: nothing is shown as if it were empty
            self.viewer.panel.set_labels(None)
            self.panel.describe(str(error), "open")
            return
        proposed = work.record(frame).proposal is not None
        if region is None:
            self.viewer.panel.set_labels(label_overlay(labels, work.classes, proposed=proposed))
            return
        (top, left), (height, width) = (region.top, region.left), region.mask.shape
        box = (  # a pixel more on each side: outlines of neighbours change too
            slice(max(0, top - 1), min(labels.shape[0], top + height + 1)),
            slice(max(0, left - 1), min(labels.shape[1], left + width + 1)),
        )
        self.viewer.panel.patch_labels(label_overlay(labels, work.classes, box), box[1].start, box[0].start)
