"""Annotating: binds the panel, the frame and the session's label maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from PySide6.QtCore import QObject

from degense.app.features.annotate.class_list import SWATCH
from degense.app.features.annotate.keys import AnnotationKeys
from degense.app.features.annotate.painter import Painter
from degense.app.features.annotate.panel import AnnotationPanel
from degense.app.features.annotate.review import PropagationReview
from degense.app.features.annotate.state import AnnotationState
from degense.app.features.annotate.tool import TOOLS, ToolName
from degense.app.features.timeline.controller import TimeControl
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.view_rendering import View
from degense.engine.annotation.edits import STATUSES, Status
from degense.engine.annotation.overlay import label_overlay
from degense.engine.annotation.painting import PixelRegion
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.annotation.edits import Proposal


class Annotator(QObject):
    """Shows the annotations of the frame in the panel and over the frame, and does what the panel asks for."""

    def __init__(self, viewer: Viewer, state: AnnotationState) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session, self.state = viewer, viewer.shell, viewer.session, state
        self.panel = AnnotationPanel()
        self.dock = self.shell.add_dock("Annotation", self.panel)
        self.painter = Painter(self.shell, state, viewer.panel)
        self.review = PropagationReview(self.shell, state, self.panel)
        AnnotationKeys(self.shell, state, self.painter, self.review)
        self._bind_panel()
        state.pixels_changed.connect(self._show_pixels)
        state.records_changed.connect(self._records_changed)
        state.classes_changed.connect(self._show_classes)
        state.tool.changed.connect(self._show_tool)
        state.tool.active_changed.connect(self._active_changed)
        self.session.opened.connect(self._show_classes)
        self.session.opened.connect(self._frame_changed)
        self.session.frame_changed.connect(lambda frame: self._frame_changed())
        viewer.shown.connect(self._shown)
        self.shell.ticked.connect(state.write_stroke)
        self.shell.leaving.connect(state.end)  # a stroke that has not ended is saved too

    def toggle(self) -> None:
        """Begin or end annotating."""
        self.state.tool.active = not self.state.tool.active

    def _active_changed(self, active: bool) -> None:
        if active:
            self.session.pause()
            self.shell.docks.bring(self.dock, height=600)
            self.viewer.panel.setFocus()
            if self.state.blocked:
                self.shell.show_error(self.state.blocked)
        self.viewer.recorded = active
        self._show_tool()
        self._frame_changed()
        self.viewer.request()
        self.shell.refresh()

    # The panel

    def _bind_panel(self) -> None:
        panel, state = self.panel, self.state
        panel.set_tools([(kind.name, kind.title, kind.description) for kind in TOOLS])
        panel.set_statuses(STATUSES)
        panel.tool_chosen.connect(lambda name: state.tool.choose(cast(ToolName, name)))
        panel.radius_chosen.connect(lambda radius: state.tool.choose(radius=radius))
        panel.lock_chosen.connect(lambda value: state.tool.lock(None if value < 0 else value))
        panel.status_chosen.connect(lambda status: self._attempt(lambda: state.set_status(cast(Status, status))))
        panel.class_added.connect(lambda name: self._attempt(lambda: state.add_class(name)))
        panel.classes.chosen.connect(state.choose_class)
        panel.classes.renamed.connect(lambda index, name: self._attempt(lambda: state.rename_class(index, name)))
        panel.classes.recoloured.connect(state.recolour_class)
        panel.asked.connect(lambda action: self.shell.menus.run(action))
        self.shell.started.connect(lambda: panel.follow(self.shell.menus.actions))

    def _attempt(self, change: Callable[[], None]) -> None:
        """Do it, or say why it cannot be done and show the classes as they are."""
        try:
            change()
        except DegenseError as error:
            self.shell.say(str(error))
            self._show_classes()

    def _show_classes(self) -> None:
        classes = self.state.work.classes if self.state.work is not None else ()
        self.panel.classes.set_classes([(kind.name, _swatch(index, classes)) for index, kind in enumerate(classes)])
        inside = [(kind.name, index) for index, kind in enumerate(classes)]
        self.panel.set_locks([("anything", -1), ("unlabelled pixels", UNLABELLED), *inside])
        self._show_tool()

    def _show_tool(self) -> None:
        tool = self.state.tool
        self.panel.set_tool(tool.name, tool.radius, -1 if tool.inside is None else tool.inside)
        self.panel.classes.set_current(tool.label)
        self.painter.show_tool()

    def _records_changed(self) -> None:
        self._show_frame()
        self.shell.refresh()

    def _frame_changed(self) -> None:
        self.painter.end()
        self._show_frame()
        if not self.state.tool.active or self.state.work is None:
            self.viewer.panel.set_labels(None)
        self.shell.refresh()

    def _show_frame(self) -> None:
        work, frame = self.state.work, self.session.frame
        self.dock.setEnabled(work is not None)
        if work is None:
            self.panel.set_frame("", "open")
            self.panel.summary.setText(self.state.blocked)
            return
        record = work.record(frame)
        if record.proposal is not None:
            text = f"proposed, confidence {record.proposal.confidence:.0%}"
        elif record.by_hand:
            text = "painted"
        elif record.labels is not None:
            text = "propagated and accepted"
        else:
            text = "labels of the clip" if work.is_labelled(frame) else "not labelled"
        self.panel.set_frame(f"Frame {frame}: {text}", record.status)
        waiting = work.waiting()
        doubtful = [index for index in waiting if cast("Proposal", work.record(index).proposal).doubtful]
        counts = [f"{sum(r.status == status for r in work.records.values())} {status}" for status in STATUSES[1:]]
        proposals = f"{len(waiting)} wait for an answer, {len(doubtful)} of them doubtful" if waiting else ""
        self.panel.summary.setText("; ".join(filter(None, [f"{work.count} frames: {', '.join(counts)}", proposals])))
        self._show_marks({index for index, record in work.records.items() if record.labels is not None})

    def _show_marks(self, labelled: set[int]) -> None:
        """Mark test frames and labelled frames in the timeline."""
        clip = self.session.clip
        if (time := self.shell.service(TimeControl)) is not None:
            time.timeline.track.set_marks(clip.test_frames if clip else (), sorted(labelled.union(clip.labelled_frames if clip else ())))

    # The frame

    def _shown(self, view: View) -> None:
        if self.state.tool.active and view.frame == self.session.frame:
            self._show_pixels(self.session.frame, None)

    def _show_pixels(self, frame: int, region: PixelRegion | None) -> None:
        """Lay the labels over the frame, as far as they changed."""
        work = self.state.work
        if work is None or not self.state.tool.active or frame != self.session.frame:
            return
        try:
            labels = self.state.labels(frame)
        except DegenseError as error:  # a damaged file: nothing is shown as if it were empty
            self.viewer.panel.set_labels(None)
            self.panel.set_frame(str(error), "open")
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


def _swatch(index: int, classes: Sequence) -> np.ndarray:
    """What a class looks like on an unlit grey, uint8 [h, w, 4]."""
    overlay = label_overlay(np.full((SWATCH - 6, SWATCH), index, np.uint8), classes).astype(np.float32)
    alpha = np.clip(overlay[..., 3:] / 255 * 1.5, 0, 1)
    swatch = np.full(overlay.shape, 255, np.uint8)
    swatch[..., :3] = 40 * (1 - alpha) + overlay[..., :3] * alpha
    return swatch
