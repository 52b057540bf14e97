"""Annotating: from the hand to label maps, and from label maps to the picture."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from PySide6.QtCore import QObject, QTimer

from degense.app.features.annotate.class_list import SWATCH
from degense.app.features.annotate.keys import AnnotationKeys
from degense.app.features.annotate.panel import AnnotationPanel
from degense.app.features.annotate.state import Tool
from degense.app.features.prompts.controller import rgb
from degense.app.features.timeline.controller import TimeControl
from degense.app.features.viewer.controller import Viewer
from degense.app.features.viewer.view_rendering import View
from degense.engine.annotation.edits import STATUSES, Status
from degense.engine.annotation.overlay import label_overlay
from degense.engine.annotation.painting import PixelRegion, brush, fill, holes, polygon, region_of, smaller_islands, whole_regions
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError
from degense.widgets.frame.paint_tools import ClickTool, PolygonTool, StrokeTool
from degense.widgets.frame.panel_tools import PanelTool

if TYPE_CHECKING:
    from degense.engine.annotation.packed import Proposal

TOOL_WORDS = (
    ("brush", "Brush", "Paint the current class"),
    ("eraser", "Eraser", "Make pixels unlabelled"),
    ("superpixels", "Superpixels", "Paint whole regions of like colour"),
    ("polygon", "Polygon", "Click corners; a double click or Enter closes, Backspace takes a corner back, Escape all"),
    ("fill", "Fill", "Give everything connected under the click the current class"),
)
SAVE_MS = 1000  # after an edit of a clip without a run


class Annotator(QObject):
    """Binds the annotation panel, the picture and the session's label maps."""

    def __init__(self, viewer: Viewer) -> None:
        super().__init__(viewer)
        self.viewer, self.shell, self.session, self.worker = viewer, viewer.shell, viewer.session, viewer.worker
        session, self.panel = self.session, AnnotationPanel()
        self.dock = self.shell.add_dock("Annotation", self.panel)
        self.shell.leaving.connect(self.end)  # a stroke that has not ended is saved too
        self.part = session.annotations
        self.strokes, self.polygons, self.clicks = StrokeTool(self), PolygonTool(self), ClickTool(self)
        self._regions: tuple[int, np.ndarray] | None = None
        self._saving = QTimer(self)
        self._saving.setSingleShot(True)
        self._saving.setInterval(SAVE_MS)
        self._saving.timeout.connect(self.save_beside_clip)
        AnnotationKeys(self)
        self._bind_tools()
        self._bind_panel()
        part = self.part
        part.pixels_changed.connect(self._pixels_changed)
        part.records_changed.connect(self._records_changed)
        part.classes_changed.connect(self._show_classes)
        part.tool_changed.connect(self._show_tool)
        part.active_changed.connect(self._active_changed)
        part.changed.connect(self._edited)
        session.opened.connect(self._opened)
        session.frame_changed.connect(lambda frame: self._frame_changed())
        viewer.shown.connect(self._shown)

    # Beginning and ending

    def toggle(self) -> None:
        """Begin or end annotating."""
        self.part.active = not self.part.active

    def _active_changed(self, active: bool) -> None:
        if active:
            self.session.pause()
            self.shell.docks.bring(self.dock, height=600)
            self.viewer.panel.setFocus()
            if self.part.blocked:
                self.shell.show_error(self.part.blocked)
        self.viewer.recorded = active
        self._show_tool()
        self._frame_changed()
        self.viewer.request()
        self.shell.refresh()

    def _opened(self) -> None:
        self.worker.cancel("annotate")
        self._regions = None
        self._saving.stop()
        self.panel.set_progress(None)
        self._show_classes()
        self._frame_changed()

    def save_beside_clip(self) -> None:
        """Keep what was done to a clip without a run; not amid a stroke, which its journal knows of."""
        self._saving.stop()
        if self.part.painting:
            self._saving.start()
            return
        try:
            self.part.save_beside_clip()
        except DegenseError as error:
            self.shell.show_error(str(error))

    def _edited(self, record: object) -> None:
        if self.part.unsaved_beside_clip and not self._saving.isActive():
            self._saving.start()

    def end(self) -> None:
        """The window closes."""
        self.part.end()
        self.save_beside_clip()

    # Tools

    def _bind_tools(self) -> None:
        shape = self._shape
        self.strokes.began.connect(self._stroke_began)
        self.strokes.moved.connect(lambda ax, ay, bx, by: self._dab((ax, ay), (bx, by)))
        self.strokes.ended.connect(self.part.end)
        self.polygons.drawn.connect(lambda corners: self._paint("Polygon", polygon(corners, shape())))
        self.clicks.clicked.connect(
            lambda x, y: self._paint("Fill", fill(self.part.labels(self.session.frame), (int(np.floor(x)), int(np.floor(y)))))
        )

    def _shape(self) -> tuple[int, int]:
        return self.session.size[1], self.session.size[0]

    def _stroke_began(self, x: float, y: float) -> None:
        try:
            self.part.begin({"eraser": "Erase", "superpixels": "Paint regions"}.get(self.part.tool, "Paint"))
        except DegenseError as error:
            self.shell.say(str(error))
            return
        self._dab((x, y), (x, y))

    def _dab(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        region = brush(start, end, self.part.radius, self._shape())
        self.part.dab(whole_regions(self._superpixels(), region) if self.part.tool == "superpixels" else region)

    def _superpixels(self) -> np.ndarray:
        """Regions of the recorded frame, int32 [H, W]; found once a frame."""
        frame = self.session.frame
        if self._regions is None or self._regions[0] != frame:
            from degense.engine.semantics.masks import superpixels

            clip, scene = self.session.clip, self.session.scene
            if clip is not None:
                picture = clip.frame(frame)
            else:
                assert scene is not None
                picture = scene.render_rgb(frame)
            self._regions = frame, superpixels(picture)
        return self._regions[1]

    def _paint(self, name: str, region: PixelRegion | None, value: int | None = None) -> None:
        try:
            if not self.part.paint(name, region, value):
                self.shell.say(f"{name}: nothing changed.")
        except DegenseError as error:
            self.shell.say(str(error))

    def fill_holes(self) -> None:
        self._paint("Fill holes", holes(self.part.labels(self.session.frame), self.part.current), self.part.current)

    def keep_largest(self) -> None:
        self._paint("Largest part", smaller_islands(self.part.labels(self.session.frame), self.part.current), UNLABELLED)

    def take_prompt(self) -> None:
        """Paint what the visible prompts find, each into the class of its name, which is made where there is none."""
        scene, view_state, frame = self.session.scene, self.session.view_state, self.session.frame
        assert scene is not None
        prompts = view_state.prompt_set

        def labels() -> np.ndarray:
            from degense.engine.scene.clip_query import decode_frame

            return decode_frame(scene, prompts, frame).labels

        def done(found: np.ndarray) -> None:
            if frame != self.session.frame or scene is not self.session.scene:
                return
            for index, text in enumerate(prompts.prompts):
                names = [kind.name.casefold() for kind in self.part.work.classes] if self.part.work else []
                if text.casefold() not in names:
                    self.part.add_class(text)
                    names.append(text.casefold())
                self._paint(f"Mask of {text}", region_of(found == index), names.index(text.casefold()))

        self.worker.submit("annotate", labels, done, self.shell.say)

    # Carrying

    def propagate(self) -> None:
        """Carry the frames that a hand has worked on, and this one, to all others."""
        work, clip, scene = self.part.ready(), self.session.clip, self.session.scene
        if clip is None:
            raise DegenseError(f"Carrying labels needs the recording, which is missing: {scene.clip_missing if scene else ''}")
        sources = {frame: work.labels(frame) for frame in work.sources(self.session.frame)}
        if not sources:
            raise DegenseError("No frame is labelled yet; paint one, and it can be carried to the others.")

        def steps() -> Generator[tuple[float, str], None, dict[int, Proposal]]:
            from degense.engine.annotation.propagation.propagate import propagate

            return propagate(clip, sources, scene)

        def progress(step: tuple[float, str]) -> None:
            self.panel.set_progress(step[0])
            self.shell.set_busy(step[1][0].upper() + step[1][1:], step[0])

        def done(carried: dict[int, Proposal]) -> None:
            self._carried_away()
            self.part.propose(carried)
            doubtful = self.part.ready().next_flagged(-1)
            more = "" if doubtful is None else " Next flagged goes to the doubtful ones."
            self.shell.say(f"Propagated to {len(carried)} frames: accept or reject them.{more}", 20)

        def failed(message: str) -> None:
            self._carried_away()
            self.shell.show_error(message)

        self.panel.set_progress(0.0)
        self.worker.submit("annotate", steps, done, failed, progress)
        self.shell.refresh()

    def _carried_away(self) -> None:
        self.shell.set_busy()
        self.panel.set_progress(None)
        self.shell.refresh()

    def stop(self) -> None:
        """Stop carrying; nothing is kept of it."""
        self.worker.cancel("annotate")
        self._carried_away()
        self.shell.say("Stopped; no frame was changed.")

    def accept(self) -> None:
        self.part.accept([self.session.frame])

    def reject(self) -> None:
        self.part.reject([self.session.frame])

    def accept_all(self) -> None:
        self.part.accept(self.part.ready().waiting())

    def reject_all(self) -> None:
        self.part.reject(self.part.ready().waiting())

    def go_to_flagged(self) -> None:
        frame = self.part.work.next_flagged(self.session.frame) if self.part.work else None
        if frame is None:
            self.shell.say("No frame is flagged or doubtful.")
        else:
            self.session.pause()
            self.session.go_to(frame)

    # The panel

    def _bind_panel(self) -> None:
        panel, part = self.panel, self.part
        panel.set_tools(TOOL_WORDS)
        panel.set_statuses(STATUSES)
        panel.tool_chosen.connect(lambda name: part.choose(tool=cast(Tool, name)))
        panel.radius_chosen.connect(lambda radius: part.choose(radius=radius))
        panel.lock_chosen.connect(lambda value: part.lock(None if value < 0 else value))
        panel.status_chosen.connect(lambda status: self._try(lambda: part.set_status(cast(Status, status))))
        panel.class_added.connect(lambda name: self._try(lambda: part.add_class(name)))
        panel.classes.chosen.connect(lambda index: part.choose(current=index))
        panel.classes.renamed.connect(lambda index, name: self._try(lambda: part.rename_class(index, name)))
        panel.classes.recoloured.connect(lambda index, colour: part.recolour_class(index, rgb(colour)))
        panel.asked.connect(lambda action: self.shell.menus.run(action))
        self.shell.started.connect(lambda: panel.follow(self.shell.menus.actions))

    def _try(self, change: Callable[[], None]) -> None:
        """Do it, and say why when it cannot be done; the panel shows then what is so."""
        try:
            change()
        except DegenseError as error:
            self.shell.say(str(error))
            self._show_classes()

    def _show_classes(self) -> None:
        work, panel = self.part.work, self.panel
        classes = work.classes if work is not None else ()
        labels = np.full((SWATCH - 6, SWATCH), 0, np.uint8)
        panel.classes.set_classes([(kind.name, _swatch(labels + np.uint8(index), classes)) for index, kind in enumerate(classes)])
        inside = [(kind.name, index) for index, kind in enumerate(classes)]
        panel.set_locks([("anything", -1), ("unlabelled pixels", UNLABELLED), *inside])
        self._show_tool()

    def _show_tool(self) -> None:
        part, panel = self.part, self.panel
        panel.set_tool(part.tool, part.radius, -1 if part.inside is None else part.inside)
        panel.classes.set_current(part.current)
        self.strokes.radius = part.radius
        tools: dict[str, PanelTool] = {"polygon": self.polygons, "fill": self.clicks}
        tool = tools.get(part.tool, self.strokes)
        if not part.active or part.tool != "polygon":
            self.polygons.cancel()
        mine = self.viewer.panel.tool() in (self.strokes, self.polygons, self.clicks)
        if part.active and self.viewer.panel.tool() is not tool:
            self.viewer.panel.set_tool(tool)
        elif mine and not part.active:
            self.viewer.panel.set_tool(None)
        self.viewer.panel.update()

    def _records_changed(self) -> None:
        self._show_frame()
        self.shell.refresh()

    def _frame_changed(self) -> None:
        self.part.end()
        self.polygons.cancel()
        self._show_frame()
        if not self.part.active or self.part.work is None:
            self.viewer.panel.set_labels(None)
        self.shell.refresh()

    def _show_frame(self) -> None:
        work, frame = self.part.work, self.session.frame
        self.dock.setEnabled(work is not None)
        if work is None:
            self.panel.set_frame("", "open")
            self.panel.set_summary(self.part.blocked)
            return
        record = work.record(frame)
        if record.proposal is not None:
            words = f"Frame {frame}: proposed, confidence {record.proposal.confidence:.0%}"
        elif record.by_hand:
            words = f"Frame {frame}: painted"
        elif record.labels is not None:
            words = f"Frame {frame}: carried and accepted"
        else:
            words = f"Frame {frame}: {'as it came' if work.is_labelled(frame) else 'not labelled'}"
        self.panel.set_frame(words, record.status)
        waiting = work.waiting()
        doubtful = [index for index in waiting if cast("Proposal", work.record(index).proposal).doubtful]
        counts = [f"{sum(r.status == status for r in work.records.values())} {status}" for status in STATUSES[1:]]
        proposals = f"{len(waiting)} wait for an answer, {len(doubtful)} of them doubtful" if waiting else ""
        self.panel.set_summary("; ".join(filter(None, [f"{work.count} frames: {', '.join(counts)}", proposals])))
        if (time := self.shell.service(TimeControl)) is not None:
            time.timeline.set_marks(self.session.clip.test_frames if self.session.clip else (), self._labelled(work.records))

    def _labelled(self, records: Sequence[int] | dict) -> list[int]:
        assert self.part.work is not None
        came = self.session.clip.labelled_frames if self.session.clip else []
        return sorted({*came, *(frame for frame, record in self.part.work.records.items() if record.labels is not None)})

    # The picture

    def _shown(self, view: View) -> None:
        if self.part.active and view.frame == self.session.frame:
            self._pixels_changed(self.session.frame, None)

    def _pixels_changed(self, frame: int, region: PixelRegion | None) -> None:
        work = self.part.work
        if work is None or not self.part.active or frame != self.session.frame:
            return
        try:
            labels = self.part.labels(frame)
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


def _swatch(labels: np.ndarray, classes: Sequence) -> np.ndarray:
    """What a class looks like, on the grey of an unlit picture."""
    overlay = label_overlay(labels, classes).astype(np.float32)
    alpha = np.clip(overlay[..., 3:] / 255 * 1.5, 0, 1)
    swatch = np.full((*labels.shape, 4), 255, np.uint8)
    swatch[..., :3] = 40 * (1 - alpha) + overlay[..., :3] * alpha
    return swatch
