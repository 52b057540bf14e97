"""The label maps of what is open, and the tool that is in the hand: the part of the session that annotating changes. No Qt."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from degense.app.session import session_file
from degense.app.session.clip_journal import ClipJournal
from degense.app.session.persistent_state import PersistentState
from degense.app.session.signal import Signal
from degense.engine.annotation.annotations import Annotations, Stroke
from degense.engine.annotation.classes import LabelClass, check_classes, default_colour, merged, named_classes
from degense.engine.annotation.edits import LabelEdit, Piece, State, Status
from degense.engine.annotation.folder import NAME, load, save
from degense.engine.annotation.packed import Proposal
from degense.engine.annotation.painting import PixelRegion
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError, RunError

if TYPE_CHECKING:
    from degense.app.session.session import Session
    from degense.engine.clip import Clip

Tool = Literal["brush", "eraser", "superpixels", "polygon", "fill"]
TOOLS: tuple[Tool, ...] = get_args(Tool)
SMALLEST, LARGEST = 0.5, 100.0  # radius of the brush, pixels
TOLD_SECONDS = 1.0  # of a stroke, after which the journal is told of it: what a crash costs at most


def folder_beside(clip: Clip) -> Path:
    """Where a clip without a run keeps its annotations."""
    return clip.path / NAME if clip.path.is_dir() else clip.path.with_name(f"{clip.path.stem}-{NAME}")


class AnnotationsPart(PersistentState):
    """Label maps with undo, journal and tools.

    A run keeps them in its folder, with the session; a clip that has no run beside itself, see `save_beside_clip`.

    Attributes
    ----------
    work : Annotations or None
        None while nothing is open, or where `blocked` says why.
    blocked : str
        Why a clip's annotations cannot be opened; they are left alone then. Empty otherwise.
    tool, radius, current, inside
        The tool, the radius of brushes (pixels), the class that is painted, and the class that alone may be painted over (None: any).

    Signals
    -------
    pixels_changed(frame, region)
        What is shown of a frame is another; None is the whole frame.
    records_changed()
        Status, proposals, which frames are labelled.
    classes_changed(), tool_changed(), active_changed(active)
    """

    def __init__(self, session: Session) -> None:
        super().__init__()
        self.session = session
        self.pixels_changed: Signal[[int, PixelRegion | None]] = Signal()
        self.records_changed: Signal[[]] = Signal()
        self.classes_changed: Signal[[]] = Signal()
        self.tool_changed: Signal[[]] = Signal()
        self.active_changed: Signal[[bool]] = Signal()
        self.work: Annotations | None = None
        self.unsaved_beside_clip = False
        self._stroke: Stroke | None = None
        self._told, self._untold = 0.0, False
        self._journal: ClipJournal | None = None
        self._active = False
        self.clear()

    # -- part of the session ---------------------------------------------------------------------------------------------------------------
    def clear(self) -> None:
        self.work, self.blocked, self._stroke, self.unsaved_beside_clip = None, "", None, False
        if self._journal is not None:
            self._journal.close()
        self._journal = None
        self.tool: Tool = "brush"
        self.radius, self.current = 8.0, 0
        self.inside: int | None = None

    def to_json(self) -> Any:
        return {"tool": self.tool, "radius": self.radius, "current": self.current, "inside": self.inside}

    def from_json(self, data: Any, source: str) -> None:
        try:
            if data["tool"] not in TOOLS:
                raise ValueError(f"{data['tool']!r} is no tool")
            self.tool, self.radius = data["tool"], min(LARGEST, max(SMALLEST, float(data["radius"])))
            self.current = max(0, int(data["current"]))
            self.inside = None if data["inside"] is None else int(data["inside"])
        except (KeyError, TypeError, ValueError) as error:
            raise RunError(f"{source} does not say how one was annotating ({error}).") from error

    def load(self, folder: Path) -> None:
        session = self.session
        assert session.scene is not None
        scene = session.scene
        self._open(folder / NAME, scene.labels, tuple(scene.clip.classes) if scene.clip and scene.clip.classes else scene.classes)

    def load_beside_clip(self) -> None:
        """Open what a clip without a run has beside itself; `blocked` says it when that is damaged."""
        clip = self.session.clip
        assert clip is not None
        try:
            self._open(folder_beside(clip), clip.labels, clip.classes)
        except DegenseError as error:
            self.work, self.blocked = None, str(error)

    def recover_beside_clip(self) -> None:
        """Make the changes again that a crash left unsaved beside a clip, and keep a journal from here on.

        Raises
        ------
        DegenseError
            When a record of the journal cannot be used; those before it are made, and the journal is set aside.
        """
        assert self.session.clip is not None
        if self.work is None:
            return
        left = ClipJournal(folder_beside(self.session.clip), self.session.store.trouble)
        try:
            for record in left.left():
                self.replay(record, str(left.path))
        except DegenseError:
            session_file.set_aside(left.path)
            raise
        finally:
            self._journal = left

    def _open(self, folder: Path, original: Any, names: Sequence[str]) -> None:
        (width, height), count = self.session.size, self.session.frames
        self.work = load(folder, (height, width), count, original) or Annotations(named_classes(names), (height, width), count, original)

    def store(self, folder: Path) -> None:
        if self.work is not None and (self.work.records or (folder / NAME).exists()):
            save(self.work, folder / NAME)

    def save_beside_clip(self) -> None:
        """Write the annotations of a clip without a run, if they have changed. DegenseError when they cannot be written."""
        if self.unsaved_beside_clip and self.work is not None and self.session.clip is not None:
            save(self.work, folder_beside(self.session.clip))
            self.unsaved_beside_clip = False
            if self._journal is not None:
                self._journal.forget()

    def replay(self, record: Any, source: str) -> None:
        try:
            if "classes" in record:
                self._put_classes(tuple(LabelClass(str(name), (int(r), int(g), int(b))) for name, (r, g, b) in record["classes"]))
            elif self.work is not None:
                self._put(tuple(Piece.from_json(item) for item in record["pieces"]))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise RunError(f"{source} does not hold strokes that can be painted again ({error}).") from error

    # -- the tool --------------------------------------------------------------------------------------------------------------------------
    @property
    def active(self) -> bool:
        """Whether one is annotating: label maps are shown, and the left button paints."""
        return self._active

    @active.setter
    def active(self, active: bool) -> None:
        if active != self._active:
            self._active = active
            self.active_changed.emit(active)

    def choose(self, tool: Tool | None = None, radius: float | None = None, current: int | None = None) -> None:
        """Take another tool, size or class; what is None stays."""
        self.tool = tool or self.tool
        self.radius = min(LARGEST, max(SMALLEST, radius)) if radius is not None else self.radius
        if current is not None and self.work is not None and 0 <= current < len(self.work.classes):
            self.current = current
        self.tool_changed.emit()

    def lock(self, inside: int | None) -> None:
        """Paint only inside a class (`UNLABELLED`: only what is unlabelled); None: everywhere."""
        self.inside = inside
        self.tool_changed.emit()

    @property
    def value(self) -> int:
        """What the tool in the hand writes."""
        return UNLABELLED if self.tool == "eraser" else self.current

    def ready(self) -> Annotations:
        """The label maps. DegenseError where there is nothing to paint on, or nothing to paint with."""
        if self.work is None:
            raise DegenseError(self.blocked or "Open a clip or a run first.")
        if not self.work.classes:
            raise DegenseError("There is no class yet: add one, then paint.")
        self.current = min(self.current, len(self.work.classes) - 1)
        return self.work

    # -- painting --------------------------------------------------------------------------------------------------------------------------
    def begin(self, name: str) -> None:
        """Begin a stroke in the frame that is shown. Errors as `ready`."""
        self._stroke = self.ready().stroke(self.session.frame, f"{name} in frame {self.session.frame}")
        self._told = -math.inf  # its first dab is told at once

    def dab(self, region: PixelRegion | None) -> None:
        """Paint a region as part of the stroke."""
        if self._stroke is not None and region is not None:
            changed = self._stroke.paint(region, self.value, self.inside)
            if changed is not None:
                self.pixels_changed.emit(self._stroke.frame, changed)
                self._untold = True
                self.tell_stroke()

    @property
    def painting(self) -> bool:
        """Whether a stroke has begun and not ended."""
        return self._stroke is not None

    def tell_stroke(self) -> None:
        """Let the journal know of a stroke that takes long. The window calls it every second: the hand may rest amid a stroke."""
        now = time.monotonic()
        if self._stroke is None or not self._untold or now - self._told < TOLD_SECONDS:
            return
        if (piece := self._stroke.so_far()) is not None:
            self._told, self._untold = now, False
            self._tell({"pieces": [piece.to_json()]})

    def end(self) -> None:
        """End the stroke: one step of undo."""
        stroke, self._stroke = self._stroke, None
        if stroke is not None:
            self._done(stroke.finish())

    def paint(self, name: str, region: PixelRegion | None, value: int | None = None) -> bool:
        """Paint a region in one step, with the tool's value unless one is given; whether that changed anything."""
        frame = self.session.frame
        edit = self.ready().paint(frame, f"{name} in frame {frame}", region, self.value if value is None else value, self.inside)
        self._done(edit)
        if edit is not None:
            self.pixels_changed.emit(frame, None)
        return edit is not None

    def labels(self, frame: int) -> np.ndarray:
        """What is to be shown of a frame, uint8 [H, W]: with the present stroke, else the proposal or its labels."""
        assert self.work is not None
        if self._stroke is not None and self._stroke.frame == frame:
            return self._stroke.labels
        return self.work.shown(frame)

    # -- frames ----------------------------------------------------------------------------------------------------------------------------
    def propose(self, proposals: Mapping[int, Proposal]) -> None:
        """Take what was carried to other frames, for review."""
        self._done(self.ready().propose(proposals))
        self.pixels_changed.emit(self.session.frame, None)

    def accept(self, frames: Sequence[int]) -> None:
        self._done(self.ready().accept(frames))
        self.pixels_changed.emit(self.session.frame, None)

    def reject(self, frames: Sequence[int]) -> None:
        self._done(self.ready().reject(frames))
        self.pixels_changed.emit(self.session.frame, None)

    def set_status(self, status: Status) -> None:
        self._done(self.ready().set_status(self.session.frame, status))

    def take(self, classes: Sequence[LabelClass], maps: Mapping[int, np.ndarray], name: str) -> None:
        """Take label maps from elsewhere, of which values index `classes`; classes of the same name are the same."""
        assert self.work is not None
        own, table = merged(self.work.classes, classes)
        if len(own) > len(self.work.classes):
            self._set_classes(f"Classes of {name}", own)
        self._done(self.work.replace_labels({frame: table[labels] for frame, labels in maps.items()}, name))
        self.pixels_changed.emit(self.session.frame, None)

    # -- classes ---------------------------------------------------------------------------------------------------------------------------
    def add_class(self, name: str) -> None:
        """Add a class in the next colour, and choose it. DegenseError for a name that will not do."""
        if self.work is None:
            raise DegenseError(self.blocked or "Open a clip or a run first.")
        classes = self.work.classes
        self._set_classes(f"Class {name}", (*classes, LabelClass(" ".join(name.split()), default_colour(len(classes)))))
        self.choose(current=len(classes))

    def rename_class(self, index: int, name: str) -> None:
        self._change_class(index, f"Rename {self.ready().classes[index].name}", name=" ".join(name.split()))

    def recolour_class(self, index: int, colour: tuple[int, int, int]) -> None:
        self._change_class(index, f"Colour of {self.ready().classes[index].name}", colour=colour)

    def _change_class(self, index: int, title: str, **changes: Any) -> None:
        classes = list(self.ready().classes)
        classes[index] = replace(classes[index], **changes)
        self._set_classes(title, tuple(classes))

    def _set_classes(self, title: str, classes: tuple[LabelClass, ...]) -> None:
        assert self.work is not None
        check_classes(classes)
        before = self.work.classes
        if classes != before:
            self._put_classes(classes)
            self.session.undo.push(title, self._put_classes, before, classes)

    def _put_classes(self, classes: tuple[LabelClass, ...]) -> None:
        if self.work is not None:
            check_classes(classes)
            self.work.classes = classes
            self._tell({"classes": [[kind.name, kind.colour] for kind in classes]})
            self.classes_changed.emit()
            self.pixels_changed.emit(self.session.frame, None)

    # -- undo and journal ------------------------------------------------------------------------------------------------------------------
    def _done(self, edit: LabelEdit | None) -> None:
        if edit is not None:
            self.session.undo.push(edit.name, self._put, edit.before, edit.after, size=edit.size)
            self._tell({"pieces": [piece.to_json() for piece in edit.after]})
            self.records_changed.emit()

    def _put(self, state: State) -> None:
        if self.work is None:
            return
        self.work.restore(state)
        self._tell({"pieces": [piece.to_json() for piece in state]})
        self.records_changed.emit()
        for piece in state:
            self.pixels_changed.emit(piece.frame, None)

    def _tell(self, record: Any) -> None:
        self.unsaved_beside_clip = self.session.scene is None
        if self._journal is not None:
            self._journal.tell(record)
        self.changed.emit(record)
